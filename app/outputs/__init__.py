"""The formats of answers: one file a format, each a pure function of what was found.

Two kinds. The texts (JSON, BOP, SHREC, CSV) are written from a checked ``DetectResponse``. The meshes (GLB, PLY, OBJ,
STL) are written by two processes: the worker makes the ``body``, which is all geometry, and the server writes the
``head``, which is all structure, and checks the body against it: a compromised worker can send
wrong numbers, but cannot make a client open an address or read beyond an array.
"""
