"""The command line `prsnet`.

Knows the library (`app.local`), the client and the server, each loaded by the commands that need it.
"""
