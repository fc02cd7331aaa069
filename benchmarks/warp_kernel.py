"""The query in warp's own language; a module of its own because warp reads its source."""

import warp as wp


@wp.kernel
def query_mesh(mesh: wp.uint64, points: wp.array(dtype=wp.vec3), squared: wp.array(dtype=wp.float32)):
    """Squared distance of every point from the mesh."""
    i = wp.tid()
    found = wp.mesh_query_point_no_sign(mesh, points[i], 1.0e6)
    difference = wp.mesh_eval_position(mesh, found.face, found.u, found.v) - points[i]
    squared[i] = wp.dot(difference, difference)
