"""The HTTP service and the command line around the ``model`` package.

``main`` wires, ``routes`` answers, ``detection`` turns bytes into an answer, ``pool`` runs that off the
event loop.
"""

from model import __version__ as __version__
