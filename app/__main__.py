"""``python -m app`` is ``prsnet``."""

from app.cli.commands import app

app()
