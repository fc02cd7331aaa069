"""Classical methods that PRS-Net is measured against, one file each; planes in the unit frame.

Know `model.geometry`; nothing of evaluation or training.
"""
