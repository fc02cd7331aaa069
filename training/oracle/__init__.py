"""The exhaustive search for all symmetries of a mesh, slow and independent of the detector: the ground truth.

Its search, closure and orders are second implementations on purpose; of `model` it takes distances and frames only.
"""
