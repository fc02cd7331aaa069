"""An S3-compatible server of our own (moto's), filled with files."""

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import pytest

pytest.importorskip("ray", reason="the extra bulk is not installed")
from moto.server import ThreadedMotoServer
from pyarrow import fs

CREDENTIALS = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_EC2_METADATA_DISABLED": "true"}


class Bucket:
    """A new bucket of a running server."""

    def __init__(self, port: int) -> None:
        self._port = port
        self.name = f"catalogue-{time.monotonic_ns()}"  # what moto keeps, it keeps for all its servers
        self.filesystem = fs.S3FileSystem(
            access_key="test", secret_key="test", region="us-east-1", scheme="http",
            endpoint_override=f"127.0.0.1:{port}", allow_bucket_creation=True,
        )  # fmt: skip
        self.filesystem.create_dir(self.name)

    def uri(self, key: str) -> str:
        return f"s3://{self.name}/{key}?endpoint_override=127.0.0.1%3A{self._port}&scheme=http&region=us-east-1"

    def put(self, files: Mapping[str, bytes]) -> None:
        for key, data in files.items():
            with self.filesystem.open_output_stream(f"{self.name}/{key}", compression=None) as stream:
                stream.write(data)


@contextmanager
def bucket() -> Iterator[Bucket]:
    """A server with an empty bucket; credentials for it are in the environment meanwhile."""
    before = {name: os.environ.get(name) for name in CREDENTIALS}
    os.environ.update(CREDENTIALS)
    server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    try:
        yield Bucket(server.get_host_and_port()[1])
    finally:
        server.stop()
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
