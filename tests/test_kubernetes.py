"""What is in ``deploy`` for clusters and proxies: valid, hardened, and in step with the service's settings."""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from app.http.main import create_app
from app.http.runtime import Runtime
from app.settings import Settings
from tests.kustomized import build

ROOT = Path(__file__).parents[1]
DEPLOY = ROOT / "deploy"
BASE = DEPLOY / "kubernetes" / "base"
KUSTOMIZATION: dict[str, Any] = yaml.safe_load((BASE / "kustomization.yaml").read_text())
SETTINGS = dict(line.split("=") for line in KUSTOMIZATION["configMapGenerator"][0]["literals"])
UNITS = {"Ki": 2**10, "Mi": 2**20, "Gi": 2**30, "k": 2**10, "m": 2**20, "g": 2**30}


def manifests() -> dict[str, dict[str, Any]]:
    """The manifests of the base by their kind."""
    documents = [yaml.safe_load((BASE / name).read_text()) for name in KUSTOMIZATION["resources"]]
    return {document["kind"]: document for document in documents}


def pod() -> dict[str, Any]:
    return manifests()["Deployment"]["spec"]["template"]["spec"]


def container() -> dict[str, Any]:
    (only,) = pod()["containers"]
    return only


def amount(text: str) -> int:
    number, unit = re.fullmatch(r"(\d+)(\w*)", text).groups()  # type: ignore[union-attr]
    return int(number) * UNITS.get(unit, 1)


def served(values: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> Settings:
    """The settings of a server with these environment variables, each of which must be one."""
    for name, value in values.items():
        assert name.removeprefix("PRSNET_").lower() in Settings.model_fields, f"{name} is no setting"
        monkeypatch.setenv(name, value)
    return Settings()


@pytest.mark.parametrize("kind", list(manifests()))
def test_manifests_fit_the_schemas(kind: str) -> None:
    kubernetes_validate.validate(manifests()[kind], kubernetes_validate.latest_version(), strict=True)


@pytest.mark.parametrize("overlay", ["base", "cpu-only"])
def test_what_is_applied_fits_the_schemas(overlay: str) -> None:
    documents = {document["kind"]: document for document in build(BASE.parent / overlay)}
    assert set(documents) == set(manifests()) | {"ConfigMap"}
    for document in documents.values():
        kubernetes_validate.validate(document, kubernetes_validate.latest_version(), strict=True)
    metrics = [metric["type"] for metric in documents["HorizontalPodAutoscaler"]["spec"]["metrics"]]
    assert metrics == (["Resource", "Pods"] if overlay == "base" else ["Resource"])
    applied = documents["Deployment"]["spec"]["template"]["spec"]["containers"][0]
    assert applied["envFrom"][0]["configMapRef"]["name"] == documents["ConfigMap"]["metadata"]["name"]
    assert documents["ConfigMap"]["data"] == {name: value.partition("  #")[0] for name, value in SETTINGS.items()}
    assert applied["image"].startswith("registry.example/")


@pytest.mark.parametrize("overlay", ["base", "cpu-only"])
@pytest.mark.skipif(shutil.which("kubectl") is None, reason="needs kubectl")
def test_kubectl_makes_the_same(overlay: str) -> None:
    """But for the hash in the name of the settings, which follows their content."""
    command = ["kubectl", "kustomize", str(BASE.parent / overlay)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    named, hashes = re.subn(r"\bprsnet-settings-[a-z0-9]{10}\b", "prsnet-settings", built.stdout)
    assert hashes == 2
    theirs = {document["kind"]: document for document in yaml.safe_load_all(named)}
    assert theirs == {document["kind"]: document for document in build(BASE.parent / overlay)}


def test_the_pod_may_do_no_more_than_it_must() -> None:
    security, inner = pod()["securityContext"], container()["securityContext"]
    assert security["runAsNonRoot"] is True
    assert security["seccompProfile"] == {"type": "RuntimeDefault"}
    assert inner["readOnlyRootFilesystem"] is True
    assert inner["allowPrivilegeEscalation"] is False
    assert inner["capabilities"] == {"drop": ["ALL"]}
    assert pod()["automountServiceAccountToken"] is False
    user = re.search(r"^USER (\d+):(\d+)$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    assert user is not None
    assert [int(part) for part in user.groups()] == [security["runAsUser"], security["runAsGroup"]]
    policy = manifests()["NetworkPolicy"]["spec"]
    assert policy["policyTypes"] == ["Ingress", "Egress"]
    assert "egress" not in policy  # nothing at all


def test_settings_of_the_cluster_are_settings_and_fit_the_pod(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = served(SETTINGS, monkeypatch)
    assert pod()["terminationGracePeriodSeconds"] >= settings.drain_s + settings.deadline_s + 5
    (volume,) = pod()["volumes"]
    room = amount(volume["emptyDir"]["sizeLimit"])
    assert room >= settings.uploads * settings.max_upload_bytes
    assert amount(container()["resources"]["limits"]["ephemeral-storage"]) > room
    secret = container()["env"][0]
    assert secret["name"].removeprefix("PRSNET_").lower() in Settings.model_fields
    # Kubernetes would set PRSNET_PORT=tcp://... for a service of this name
    assert manifests()["Service"]["metadata"]["name"] == "prsnet"
    assert pod()["enableServiceLinks"] is False


def test_probes_ask_what_there_is_at_the_port_of_the_image() -> None:
    paths = create_app(Settings()).openapi()["paths"]
    (port,) = container()["ports"]
    assert f"EXPOSE {port['containerPort']}" in (ROOT / "Dockerfile").read_text()
    for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
        question = container()[probe]["httpGet"]
        assert question["port"] == port["name"] == manifests()["Service"]["spec"]["ports"][0]["targetPort"]
        assert question["path"] in paths
    # an instance that drains is not to be ended for it
    assert container()["livenessProbe"]["httpGet"]["path"] == "/health/live"


def test_the_autoscaler_looks_at_a_metric_that_exists() -> None:
    exported = {family.name for family in Runtime(Settings()).metrics.registry.collect()}
    metrics = manifests()["HorizontalPodAutoscaler"]["spec"]["metrics"]
    (asked,) = [metric["pods"]["metric"]["name"] for metric in metrics if metric["type"] == "Pods"]
    adapter = yaml.safe_load((DEPLOY / "kubernetes" / "prometheus-adapter.yaml").read_text())
    (rule,) = adapter["rules"]["custom"]
    assert rule["seriesQuery"].partition("{")[0] == asked
    assert asked in exported


def test_everything_names_the_same_pods() -> None:
    found = manifests()
    labels = found["Deployment"]["spec"]["template"]["metadata"]["labels"]
    selectors = [
        found["Deployment"]["spec"]["selector"]["matchLabels"],
        found["Service"]["spec"]["selector"],
        found["PodDisruptionBudget"]["spec"]["selector"]["matchLabels"],
        found["NetworkPolicy"]["spec"]["podSelector"]["matchLabels"],
    ]
    assert all(selector.items() <= labels.items() for selector in selectors)
    assert found["HorizontalPodAutoscaler"]["spec"]["scaleTargetRef"]["name"] == found["Deployment"]["metadata"]["name"]


def test_compose_and_proxy_fit_the_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    compose = yaml.safe_load((DEPLOY / "compose.yaml").read_text())
    instances = {name: service for name, service in compose["services"].items() if name != "proxy"}
    proxy = (DEPLOY / "nginx.conf").read_text()
    assert set(re.findall(r"server ([\w-]+):8000", proxy)) == set(instances)
    for service in instances.values():
        settings = served(service["environment"], monkeypatch)
        assert service["read_only"] is True
        assert service["cap_drop"] == ["ALL"]
        assert float(service["stop_grace_period"][:-1]) >= settings.drain_s + settings.deadline_s + 5
        (mount,) = service["tmpfs"]
        room = amount(mount.partition("size=")[2])
        assert room >= settings.uploads * settings.max_upload_bytes
        assert amount(service["mem_limit"]) > room
        assert amount(found(proxy, "client_max_body_size")) >= settings.max_upload_bytes
        assert float(found(proxy, "proxy_read_timeout")[:-1]) > settings.deadline_s
        assert float(found(proxy, "keepalive_timeout")[:-1]) < settings.keep_alive_s
        assert float(found(proxy, "client_body_timeout")[:-1]) == settings.stall_s


def found(proxy: str, directive: str) -> str:
    values = re.findall(rf"^\s*{directive} (\S+);", proxy, re.MULTILINE)
    assert len(values) == 1, directive
    return values[0]
