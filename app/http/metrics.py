"""The metrics of ``GET /metrics``, for Prometheus. Labels take few values, none of which a client chooses."""

from collections.abc import Callable, Mapping

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, generate_latest

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_ROUTES = frozenset(
    {
        "/",
        "/detect",
        "/complete",
        "/halve",
        "/sector",
        "/align",
        "/health",
        "/health/live",
        "/model",
        "/metrics",
        "/docs",
        "/openapi.json",
    }
)
_METHODS = frozenset({"GET", "HEAD", "POST", "OPTIONS"})
_SECONDS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0)


class Metrics:
    """The metrics of one application, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        own = self.registry
        self._requests = Counter("prsnet_requests", "Requests answered.", ["route", "method", "status"], registry=own)
        self._seconds = Histogram(
            "prsnet_request_seconds", "Time to the answer.", ["route"], buckets=_SECONDS, registry=own
        )
        self._stages = Histogram(
            "prsnet_stage_seconds", "Time of each stage of a detection.", ["stage"], buckets=_SECONDS, registry=own
        )
        self._rejections = Counter(
            "prsnet_rejections", "Requests answered with a problem, by its type.", ["reason"], registry=own
        )
        self._restarts = Counter("prsnet_worker_restarts", "Workers replaced, by the reason.", ["reason"], registry=own)
        self._model = Gauge(
            "prsnet_model_info", "The model that is served.", ["name", "version", "sha256"], registry=own
        )
        ProcessCollector(registry=self.registry)
        self._of: dict[tuple[str, str, int, str], tuple[Counter, Histogram, Counter | None]] = {}

    def observe_request(self, path: str, method: str, status: int, seconds: float, reason: str) -> None:
        """Count a request that has been answered; ``reason`` is the type of its problem, or empty."""
        route = path if path in _ROUTES else "/static" if path.startswith("/static/") else "other"
        key = route, method if method in _METHODS else "other", status, reason
        found = self._of.get(key)
        if found is None:  # to find them by their labels costs more than to count
            found = self._of[key] = (
                self._requests.labels(route, key[1], str(status)),
                self._seconds.labels(route),
                self._rejections.labels(reason) if reason else None,
            )
        requests, all_seconds, rejections = found
        requests.inc()
        all_seconds.observe(seconds)
        if rejections is not None:
            rejections.inc()

    def observe_stages(self, milliseconds: Mapping[str, float]) -> None:
        """Note how long the stages of one request took."""
        for stage, value in milliseconds.items():
            self._stages.labels(stage).observe(value / 1e3)

    def count_restart(self, reason: str) -> None:
        """A worker was replaced."""
        self._restarts.labels(reason).inc()

    def set_model(self, name: str, version: str, sha256: str) -> None:
        """The weights are loaded."""
        self._model.labels(name, version, sha256).set(1)

    def watch(self, name: str, description: str, read: Callable[[], float]) -> None:
        """A gauge that is read when it is asked for."""
        Gauge(f"prsnet_{name}", description, registry=self.registry).set_function(read)

    def text(self) -> bytes:
        """All metrics in Prometheus' text format."""
        return generate_latest(self.registry)
