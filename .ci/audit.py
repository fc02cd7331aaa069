"""Looks the pinned dependencies up in the advisory database; exit code 1 only where a vulnerability is known.

A machine that does not reach the database (CI behind a mirror, say) is told so, and that nothing was checked.
"""

import json
import subprocess
import sys
from typing import Any


def main() -> int:
    """Run pip-audit over constraints.txt."""
    command = ["-m", "pip_audit", "-r", "constraints.txt", "--no-deps", "--disable-pip", "--progress-spinner", "off"]
    try:
        result = subprocess.run(
            [sys.executable, *command, "--format", "json"], capture_output=True, text=True, timeout=300, check=False
        )
        found: list[dict[str, Any]] = json.loads(result.stdout)["dependencies"]
    except (subprocess.TimeoutExpired, ValueError, KeyError):
        print("audit: skipped, the advisory database does not answer")
        return 0
    checked = [entry for entry in found if "vulns" in entry]
    if not checked:
        print(f"audit: skipped, the advisory database knows none of the {len(found)} packages from here")
        return 0
    bad = [entry for entry in checked if entry["vulns"]]
    for entry in bad:
        names = ", ".join(vulnerability["id"] for vulnerability in entry["vulns"])
        print(f"audit: {entry['name']} {entry['version']}: {names}")
    print(f"audit: {len(checked)} of {len(found)} packages checked, {len(bad)} with known vulnerabilities")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
