"""Processes in which untrusted meshes are parsed and computed on, and which can be killed.

``pool`` (in the server) hands jobs to workers and replaces those that end; ``zygote_client`` (in the server) talks to
the ``zygote``, a process that has everything loaded and forks workers in milliseconds; ``worker`` is what those run,
inside the limits of ``sandbox``. ``wire`` is their protocol, ``verify`` checks what a worker answers.
"""
