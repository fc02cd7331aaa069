"""Writes docs/openapi.json from the application: `python docs/make_openapi.py`."""

from pathlib import Path

from app.http.main import create_app
from app.http.openapi import dump

if __name__ == "__main__":
    Path(__file__).with_name("openapi.json").write_text(dump(create_app()), encoding="utf-8")
