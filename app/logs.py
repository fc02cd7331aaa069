"""Logs: one JSON object a line, or plain text for people. No file content, no key, ever."""

import json
import logging
import sys
import time
from typing import Any

from app.settings import Settings

_TEXT = "%(asctime)s %(levelname)s %(message)s"


class JsonFormatter(logging.Formatter):
    """A record as one line of JSON; members given as ``extra={"fields": {...}}`` are added."""

    def format(self, record: logging.LogRecord) -> str:
        """The line."""
        seconds = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        entry: dict[str, Any] = {
            "time": f"{seconds}.{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **getattr(record, "fields", {}),
        }
        if record.exc_info:
            entry["exception"] = self.formatException(record.exc_info)
        return json.dumps(entry)


def configure(settings: Settings) -> None:
    """Log to standard error in the format and from the level that the settings name."""
    handler = logging.StreamHandler(sys.stderr)
    text = settings.log_format == "text" or (settings.log_format == "auto" and sys.stderr.isatty())
    handler.setFormatter(logging.Formatter(_TEXT, "%H:%M:%S") if text else JsonFormatter())
    if text and settings.log_level == "info":  # what the server is doing is told by our own lines
        logging.getLogger("uvicorn.error").setLevel(logging.WARNING)
    logging.basicConfig(level=settings.log_level.upper(), handlers=[handler], force=True)
