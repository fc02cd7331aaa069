"""What ``kubectl kustomize`` makes of the folders in ``deploy/kubernetes``, where there is no kubectl.

It knows what is used there and fails at anything else; where there is kubectl, a test compares the two.
"""

from pathlib import Path
from typing import Any

import yaml

KNOWN = {"apiVersion", "kind", "labels", "resources", "configMapGenerator", "images", "patches"}
Document = dict[str, Any]


def build(folder: Path) -> list[Document]:
    """The documents of a folder with a ``kustomization.yaml``; names of config maps have no hash."""
    wanted: Document = yaml.safe_load((folder / "kustomization.yaml").read_text())
    assert set(wanted) <= KNOWN, set(wanted) - KNOWN
    documents: list[Document] = []
    for name in wanted["resources"]:
        at = folder / name
        documents += build(at) if at.is_dir() else list(yaml.safe_load_all(at.read_text()))
    for made in wanted.get("configMapGenerator", ()):
        data = dict(line.split("=", 1) for line in made["literals"])
        documents.append({"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": made["name"]}, "data": data})
    for labels in wanted.get("labels", ()):
        assert labels["includeSelectors"] is True
        for document in documents:
            for place in _labelled(document):
                place.update(labels["pairs"])
    for image in wanted.get("images", ()):
        for document in documents:
            for container in _pod(document).get("spec", {}).get("containers", ()):
                if container["image"].partition(":")[0] == image["name"]:
                    container["image"] = f"{image['newName']}:{image['newTag']}"
    for patch in wanted.get("patches", ()):
        (target,) = [document for document in documents if _is_target(document, patch["target"])]
        for operation in yaml.safe_load(patch["patch"]):
            _remove(target, operation)
    return documents


def _pod(document: Document) -> Document:
    return document["spec"]["template"] if document["kind"] == "Deployment" else {}


def _labelled(document: Document) -> list[Document]:
    """All places that labels belong to: a document's own, its selectors', its pods'."""
    places = [document["metadata"].setdefault("labels", {})]
    spec, kind = document.get("spec", {}), document["kind"]
    if kind == "Service":
        places.append(spec["selector"])
    elif kind in ("Deployment", "PodDisruptionBudget"):
        places.append(spec["selector"]["matchLabels"])
    elif kind == "NetworkPolicy":
        places.append(spec["podSelector"]["matchLabels"])
    if kind == "Deployment":
        places.append(_pod(document)["metadata"]["labels"])
    return places


def _is_target(document: Document, target: Document) -> bool:
    return document["kind"] == target["kind"] and document["metadata"]["name"] == target["name"]


def _remove(document: Document, operation: Document) -> None:
    """A JSON patch that takes something out (RFC 6902)."""
    assert operation["op"] == "remove", operation
    *way, last = operation["path"].strip("/").split("/")
    place: Any = document
    for step in way:
        place = place[int(step) if isinstance(place, list) else step]
    del place[int(last) if isinstance(place, list) else last]
