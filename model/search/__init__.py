"""Full mode: from candidates to the whole symmetry group, refined and judged on exact distances.

Knows `model.geometry` and takes the proposals of `model.network`; works in the unit frame and knows no file.
"""
