"""Prepared sets: made from folders of meshes, labelled, mixed, stored, and drawn from in training.

`prepare` and `labels` may use everything in `model`; what `fit` reads with needs torch and numpy alone.
"""
