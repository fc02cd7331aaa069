"""Dashboard and alert rules name metrics and reasons that exist."""

import json
import re
from pathlib import Path
from typing import Any

import yaml

from app import problems
from app.http.runtime import Runtime
from app.settings import Settings

DEPLOY = Path(__file__).parents[1] / "deploy"


def known() -> set[str]:
    """Names of all samples, of metrics that nothing has happened to as well."""
    names = {"process_resident_memory_bytes"}
    for family in Runtime(Settings()).metrics.registry.collect():
        ends = {"counter": ["_total"], "histogram": ["_bucket", "_count", "_sum"]}.get(family.type, [""])
        names |= {family.name + end for end in ends}
    return names


def expressions() -> list[str]:
    rules = yaml.safe_load((DEPLOY / "prometheus" / "alerts.yml").read_text())
    dashboard: dict[str, Any] = json.loads((DEPLOY / "grafana" / "dashboard.json").read_text())
    found = [rule["expr"] for group in rules["groups"] for rule in group["rules"]]
    return found + [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]


def test_every_metric_that_is_asked_for_exists() -> None:
    asked = {name for text in expressions() for name in re.findall(r"\b(?:prsnet|process)_[a-z_]+", text)}
    assert len(asked) > 8
    assert asked <= known()


def test_every_reason_that_is_asked_for_exists() -> None:
    source = (Path(problems.__file__).parent / "workers" / "pool.py").read_text()
    slugs = {value.slug for value in vars(problems).values() if isinstance(value, problems.ProblemType)}
    for text in expressions():
        for metric, reasons in re.findall(r'prsnet_(\w+?)_total\{reason=~?"([^"]+)"', text):
            for reason in reasons.split("|"):
                assert reason in slugs if metric == "rejections" else f'"{reason}"' in source
