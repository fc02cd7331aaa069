"""``python -m app`` is ``prsnet``."""

from app.cli import app

app()
