"""Triangle meshes: the mesh itself, its edges, and how triangles are cut.

Knows arrays and `model.errors` only; what is exact or symmetric is for `model.geometry` and `model.search`.
"""
