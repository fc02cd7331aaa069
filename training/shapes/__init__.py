"""Procedural shapes whose symmetries are known exactly, and the point groups they realise.

Knows arrays only.
"""
