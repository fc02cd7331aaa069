"""What a mirror plane is good for: completing, symmetrizing and halving a mesh (the paper, section 6).

Knows `model.meshes` and `model.geometry`; the plane comes from the caller.
"""
