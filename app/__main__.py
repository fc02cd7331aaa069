"""``python -m app`` is ``prsnet``."""

from app.cli.commands import main

main()
