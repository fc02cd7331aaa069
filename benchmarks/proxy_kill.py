"""Clients of the two instances of ``deploy/compose.yaml`` behind nginx, one of which is killed meanwhile.

    python benchmarks/proxy_kill.py URL FILE --seconds 10 --kill COMMAND

COMMAND kills an instance after a third of the time. Needs nothing but Python. Prints one line of JSON; the exit code is
1 if a client was left without a right answer. ``--retries 0``: clients that do not try again.
"""

import argparse
import collections
import json
import shlex
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

BOUNDARY = "proxy-kill-7d1f"


class Clients:
    """Ask over and over, each over connections of its own, and count what comes."""

    def __init__(self, url: str, file: Path, retries: int) -> None:
        head = f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="file"; filename="{file.name}"\r\n\r\n'
        self._url = url
        self._body = head.encode() + file.read_bytes() + f"\r\n--{BOUNDARY}--\r\n".encode()
        self._retries = retries
        self.group = self.ask()[1]
        self.outcomes: collections.Counter[str] = collections.Counter()
        self.tries: collections.Counter[str] = collections.Counter()
        self.slowest = 0.0
        self._lock = threading.Lock()

    def ask(self) -> tuple[str, str]:
        """Status, or the name of the error, and the point group of one request."""
        headers = {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}"}
        request = urllib.request.Request(f"{self._url}/detect", self._body, headers)
        try:
            with urllib.request.urlopen(request, timeout=60) as response:
                return str(response.status), json.load(response)["point_group"]
        except urllib.error.HTTPError as error:
            return str(error.code), ""
        except (OSError, ValueError) as error:
            return type(error).__name__, ""

    def run(self, seconds: float) -> None:
        """One client."""
        end = time.monotonic() + seconds
        while (began := time.monotonic()) < end:
            for attempt in range(self._retries + 1):
                status, group = self.ask()
                with self._lock:
                    self.tries[status] += 1
                if status == "200":
                    break
                time.sleep(0.2 * (attempt + 1))
            outcome = "answered" if status == "200" and group == self.group else "wrong" if status == "200" else "lost"
            with self._lock:
                self.outcomes[outcome] += 1
                self.slowest = max(self.slowest, time.monotonic() - began)


def main() -> int:
    """Run the clients, kill an instance, count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url")
    parser.add_argument("file", type=Path)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--clients", type=int, default=4)
    parser.add_argument("--retries", type=int, default=4)
    parser.add_argument("--kill", default="")
    options = parser.parse_args()
    clients = Clients(options.url, options.file, options.retries)
    threads = [threading.Thread(target=clients.run, args=(options.seconds,)) for _ in range(options.clients)]
    for thread in threads:
        thread.start()
    time.sleep(options.seconds / 3)
    with clients._lock:
        before = clients.outcomes.total()
    if options.kill:
        subprocess.run(shlex.split(options.kill), check=True, stdout=subprocess.DEVNULL)
    for thread in threads:
        thread.join()
    told = {
        "outcomes": dict(clients.outcomes),
        "tries": dict(clients.tries),
        "before_kill": before,
        "slowest_s": round(clients.slowest, 2),
    }
    print(json.dumps(told))
    return 0 if set(clients.outcomes) == {"answered"} and clients.outcomes["answered"] > before > 0 else 1


if __name__ == "__main__":
    sys.exit(main())
