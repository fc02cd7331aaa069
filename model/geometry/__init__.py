"""Exact geometry in the unit frame: voxels, samples, distances to a surface, isometries and their refinement.

Knows arrays, nothing of files, of the network, or of which symmetries are wanted.
"""
