"""Clients of a running service, blocking and asynchronous.

Knows `app.schemas` and httpx; needs neither torch nor the server.
"""
