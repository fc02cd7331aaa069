"""Comparing two meshes: the same part, its mirror image, or another one."""
