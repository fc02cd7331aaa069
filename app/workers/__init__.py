"""Processes in which strangers' meshes are parsed and computed on, and which can be killed.

``pool`` (in the server) hands jobs to workers and replaces those that end; ``factory`` (in the server) talks to the
``zygote``, a process that has everything loaded and forks workers in milliseconds; ``worker`` is what those run,
inside the limits of ``sandbox``. ``wire`` is how they talk, ``verify`` why the server believes an answer.
"""
