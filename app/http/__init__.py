"""The service: the FastAPI application, its endpoints, uploads, errors, limits and documentation.

Checks, waits and answers; meshes are parsed and computed on in `app.workers`.
"""
