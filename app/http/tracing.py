"""Optional traces: one span a request, with its stages, sent by OTLP. Needs the extra: ``pip install 'prsnet[otel]'``.

Where they are sent is set by OpenTelemetry's own variables (``OTEL_EXPORTER_OTLP_ENDPOINT`` and the like).
"""

import time
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from starlette.types import Scope

from app import __version__

Trace: TypeAlias = Callable[[Scope, int, float], None]
"""Told of each request that is over: its ASGI scope, its status, the seconds it took."""


class TracingNotInstalledError(Exception):
    """Traces are switched on, and the extra is missing."""


def tracer(exporter: Any = None) -> tuple[Trace, Callable[[], None]]:
    """What records requests, and what sends the last of them at the end; ``exporter`` stands in for OTLP in tests.

    Raises:
        TracingNotInstalledError: the extra is missing.
    """
    try:
        from opentelemetry import trace
        from opentelemetry.propagate import extract
        from opentelemetry.sdk.resources import Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor

        if exporter is None:
            from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter

            exporter = OTLPSpanExporter()
    except ImportError as error:
        raise TracingNotInstalledError("PRSNET_OTEL needs the extra: pip install 'prsnet[otel]'") from error
    provider = TracerProvider(resource=Resource.create({"service.name": "prsnet", "service.version": __version__}))
    provider.add_span_processor(BatchSpanProcessor(exporter))
    spans = provider.get_tracer("prsnet")

    def record(scope: Scope, status: int, seconds: float) -> None:
        end = time.time_ns()
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        span = spans.start_span(
            f"{scope['method']} {scope['path'][:100]}",
            context=extract(headers),
            kind=trace.SpanKind.SERVER,
            start_time=end - int(seconds * 1e9),
        )
        stages: Mapping[str, float] = scope.get("stages", {})
        span.set_attributes(
            {
                "http.request.method": scope["method"],
                "url.path": scope["path"][:100],
                "http.response.status_code": status,
                "prsnet.request_id": scope["request_id"],
                "prsnet.problem": scope.get("problem", ""),
                **{f"prsnet.{name}_ms": value for name, value in stages.items()},
            }
        )
        if status >= 500:
            span.set_status(trace.StatusCode.ERROR)
        span.end(end)

    return record, provider.shutdown
