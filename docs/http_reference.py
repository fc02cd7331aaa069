"""Writes docs/http.md from docs/openapi.json: `python docs/http_reference.py`. A test compares the two."""

import json
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent


def reference(document: dict[str, Any]) -> str:
    """The page."""
    lines = ["# HTTP reference", "", "Written from the service's own description, `GET /openapi.json`.", ""]
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            lines += _operation(method, path, operation)
    lines += ["## Members", ""]
    for name, schema in sorted(document["components"]["schemas"].items()):
        lines += _schema(name, schema)
    return "\n".join(lines).rstrip() + "\n"


def _operation(method: str, path: str, operation: dict[str, Any]) -> list[str]:
    lines = [f"## {method.upper()} {path}", "", f"{operation['summary']}. {operation.get('description', '')}", ""]
    for sample in operation.get("x-codeSamples", []):
        lines += ["```sh", sample["source"], "```", ""]
    if parameters := operation.get("parameters"):
        lines += ["| query | default | meaning |", "| --- | --- | --- |"]
        for item in parameters:
            header = " (header)" if item["in"] == "header" else ""
            name = f"`{item['name']}` {_type(item['schema'])}{header}"
            lines.append(f"| {name} | {_default(item['schema'])} | {_cell(item.get('description'))} |")
        lines.append("")
    lines += ["| status | body | |", "| --- | --- | --- |"]
    for status, answer in operation["responses"].items():
        for media, content in answer.get("content", {"": {}}).items():
            problems = ", ".join(f"`{slug}`" for slug in content.get("examples", {}))
            text = problems or _cell(content.get("description")) or _cell(answer["description"])
            lines.append(f"| {status} | {_body(media, content)} | {text} |")
    return [*lines, ""]


def _body(media: str, content: dict[str, Any]) -> str:
    reference = content.get("schema", {}).get("$ref", "")
    return media + (f" ({_link(reference)})" if reference else "")


def _schema(name: str, schema: dict[str, Any]) -> list[str]:
    lines = [f"### {name}", "", _cell(schema.get("description")), ""]
    if members := schema.get("properties"):
        lines += ["| member | type | meaning |", "| --- | --- | --- |"]
        lines += [f"| `{key}` | {_type(value)} | {_cell(value.get('description'))} |" for key, value in members.items()]
        lines.append("")
    return lines


def _type(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        return _link(schema["$ref"])
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return " or ".join(f"`{value}`" for value in schema["enum"])
    for choice in ("anyOf", "oneOf"):
        if choice in schema:
            return " or ".join(_type(item) for item in schema[choice])
    if schema.get("type") == "array":
        return f"list of {_type(schema.get('items', {}))}"
    return schema.get("type", "any")


def _link(reference: str) -> str:
    name = reference.rsplit("/", 1)[-1]
    return f"[{name}](#{name.lower()})"


def _default(schema: dict[str, Any]) -> str:
    return f"`{json.dumps(schema['default'])}`" if "default" in schema else ""


def _cell(text: str | None) -> str:
    return " ".join((text or "").split()).replace("|", "\\|")


if __name__ == "__main__":
    (DOCS / "http.md").write_text(reference(json.loads((DOCS / "openapi.json").read_text())))
