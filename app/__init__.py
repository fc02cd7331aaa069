"""The HTTP service and the command line around the ``model`` package.

``main`` wires, ``routes`` answers, ``detection`` turns bytes into an answer, ``pool`` runs that off the
event loop.
"""

__version__ = "0.1.0"
