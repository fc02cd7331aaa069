#!/usr/bin/env bash
# Builds the Dockerfile, runs the image as a careful operator would (read-only, no capabilities, 1 GB, not root), uses it,
# and kills one of two containers behind the proxy of deploy/ under load.
# Debian and root; needs neither a container daemon nor an image registry. BASE_IMAGE= names a base image to pull instead
# of the one made here; PORT= another port on this host.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! { [ "$(id -u)" = 0 ] && [ -f /etc/debian_version ]; }; then
  echo "container check: needs root on Debian" >&2
  if [ "${CI:-}" = true ]; then exit 1; fi
  echo "container check: skipped"
  exit 0
fi

port=${PORT:-18080}
image=localhost/prsnet:check
state=$(mktemp -d /var/tmp/prsnet-container.XXXXXX)
base=${BASE_IMAGE:-}
container=
compose=(true)

finish() {
  local code=$?
  if [ -n "$container" ] && [ "$code" != 0 ]; then podman logs "$container" 2>&1 | tail -n 40 || true; fi
  if [ -n "$container" ]; then podman rm -f "$container" >/dev/null 2>&1 || true; fi
  "${compose[@]}" down >/dev/null 2>&1 || true
  # what a container held is let go of a moment after it has been removed
  for _ in $(seq 50); do
    if ! mountpoint -q "$state/graph/overlay"; then break; fi
    umount "$state/graph/overlay" 2>/dev/null || sleep 0.2
  done
  rm -rf "$state"
  exit "$code"
}
fail() { echo "container check: $*" >&2; exit 1; }
step() { echo "container check: [$SECONDS s] $*"; }

install_engine() {
  local missing=() name
  for name in podman podman-compose runc slirp4netns mmdebstrap curl iptables; do
    command -v "$name" >/dev/null || missing+=("$name")
  done
  for name in netavark aardvark-dns; do  # networks of containers, and their names in them
    [ -x "/usr/lib/podman/$name" ] || missing+=("$name")
  done
  if [ "${#missing[@]}" = 0 ]; then return; fi
  apt-get update -qq
  DEBIAN_FRONTEND=noninteractive apt-get install -yqq --no-install-recommends "${missing[@]}" >"$state/apt.log" 2>&1 ||
    { tail -n 20 "$state/apt.log"; fail "could not install ${missing[*]}"; }
}

# A store and settings of our own: nothing of the host's podman is used or left behind. crun does not run inside every
# sandbox, so runc does; without systemd the control groups, the event log and the limits must be told as well.
configure_engine() {
  printf '[storage]\ndriver = "overlay"\ngraphroot = "%s/graph"\nrunroot = "%s/run"\n' "$state" "$state" \
    >"$state/storage.conf"
  printf '%s\n' '[containers]' 'default_ulimits = ["nofile=4096:4096", "nproc=4096:4096"]' \
    '[engine]' 'runtime = "runc"' 'cgroup_manager = "cgroupfs"' 'events_logger = "file"' \
    '[network]' 'network_backend = "netavark"' "network_config_dir = \"$state/networks\"" >"$state/containers.conf"
  export CONTAINERS_STORAGE_CONF=$state/storage.conf CONTAINERS_CONF=$state/containers.conf
  export DISABLE_HC_SYSTEMD=true TMPDIR=$state
}

make_base() {
  local bundle=/etc/ssl/certs/ca-certificates.crt
  bash .ci/base-image.sh "$state/base.tar"
  podman import -q -c 'CMD ["python3"]' -c 'ENV PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin' \
    -c "ENV SSL_CERT_FILE=$bundle" -c "ENV PIP_CERT=$bundle" "$state/base.tar" "$1" >/dev/null
  rm "$state/base.tar"
}

# The host's pip settings, and the local folders they name, are lent to the build steps; the image keeps none of it.
lend_pip_settings() {
  local file folder
  for file in /etc/pip.conf "$HOME/.config/pip/pip.conf" "$HOME/.pip/pip.conf"; do
    if [ -f "$file" ]; then lent+=(-v "$file:${file/#$HOME//root}:ro"); fi
  done
  while read -r folder; do
    if [ -d "$folder" ]; then lent+=(-v "$folder:$folder:ro"); fi
  done < <(python3 -m pip config list 2>/dev/null | grep -E 'find-links|index-url' |
    grep -oE "(file://)?/[^ ']+" | sed -E 's#^file://##; s#/simple/?$##' | sort -u)
}

build() {
  local lent=()
  if [ -z "$base" ]; then
    base=localhost/python:base
    make_base "$base"
    step "base image made"
  fi
  lend_pip_settings
  # the docker format: the OCI one has no HEALTHCHECK; no layers: nothing is built twice from this store
  podman build -q --layers=false --network host --format docker --build-arg "BASE_IMAGE=$base" \
    --build-arg "TORCH_INDEX=${TORCH_INDEX:-}" "${lent[@]}" -t "$image" . >"$state/build.log" 2>&1 ||
    { tail -n 40 "$state/build.log"; fail "the image does not build"; }
  step "built, $(podman images --format '{{.Size}}' "$image"), of which base $(podman images --format '{{.Size}}' "$base")"
}

run_image() { # PORT [OPTION...]
  podman run -d --network slirp4netns -p "127.0.0.1:$1:8000" --read-only --tmpfs /tmp:rw,size=128m \
    --cap-drop ALL --security-opt no-new-privileges --memory 1g --pids-limit 256 "${@:2}" "$image"
}

await_healthy() { # PORT CONTAINER
  local began=$SECONDS
  until curl -fsS -m 2 "http://127.0.0.1:$1/health" >"$state/health" 2>/dev/null; do
    if [ "$((SECONDS - began))" -gt 90 ]; then fail "not healthy after 90 s"; fi
    if [ "$(podman inspect -f '{{.State.Running}}' "$2")" != true ]; then fail "it does not run"; fi
    sleep 0.2
  done
  step "healthy after $((SECONDS - began)) s: $(cat "$state/health")"
}

start() {
  container=$(run_image "$port")
  await_healthy "$port" "$container"
}

hardened() {
  local users
  users=$(podman top "$container" huser | tail -n +2 | sort -u)
  if grep -qwE '0|root' <<<"$users"; then fail "it runs as root"; fi
  if podman exec "$container" sh -c ': >/probe' 2>/dev/null; then fail "the root file system is writable"; fi
  podman healthcheck run "$container" >/dev/null || fail "HEALTHCHECK says unhealthy"
  # kernels come from the cache made at build time, and none is compiled anew
  podman exec -e NUMBA_DEBUG_CACHE=1 "$container" prsnet warmup >"$state/warmup" 2>&1 || fail "warmup: $(cat "$state/warmup")"
  grep -q 'data loaded from' "$state/warmup" || fail "no kernel was loaded from the cache"
  if grep -q 'data saved to\|index saved to' "$state/warmup"; then fail "a kernel was missing from the cache"; fi
  step "user $users, read-only, $(grep -c 'data loaded from' "$state/warmup") kernels from the cache; $(tail -n 1 "$state/warmup")"
}

detects() {
  curl -fsS -m 60 -F file=@tests/data/chair.obj "http://127.0.0.1:$port/detect" >"$state/answer"
  podman exec -i "$container" python -c '
import json, sys
answer = json.load(sys.stdin)
best = answer["planes"][0]
assert abs(best["normal"][0]) > 0.999 and abs(best["offset"]) < 0.01, best
print("container check: the chair has the mirror plane", best["normal"], best["offset"])' <"$state/answer" ||
    fail "the chair has no mirror plane: $(head -c 2000 "$state/answer")"
  local memory
  memory=$(podman stats --no-stream --format '{{.MemUsage}}' "$container" 2>/dev/null || echo "not measured")
  step "memory in use: $memory"
}

stops() {
  local code
  podman stop -t 30 "$container" >/dev/null
  code=$(podman inspect -f '{{.State.ExitCode}}' "$container")
  case $code in 0 | 143) ;; *) fail "exit code $code after SIGTERM" ;; esac
  podman logs "$container" >"$state/log" 2>&1
  grep -q 'Application shutdown complete' "$state/log" || fail "no orderly shutdown in the log"
  step "SIGTERM: orderly shutdown, exit code $code"
}

# What the image says it holds: version, revision, and a bill of materials with the pinned packages in it.
described() {
  podman exec -i "$container" python - <<'PYTHON' || fail "the bill of materials is not what is installed"
import importlib.metadata as m, json
listed = {c["name"].lower(): c["version"] for c in json.load(open("/srv/sbom.cdx.json"))["components"]}
installed = {d.metadata["Name"].lower(): d.version for d in m.distributions() if d.metadata["Name"] != "prsnet"}
assert installed.items() <= listed.items(), set(installed.items()) - set(listed.items())
print("container check: bill of materials:", len(listed), "packages")
PYTHON
  podman inspect -f '{{index .Config.Labels "org.opencontainers.image.title"}}' "$image" | grep -qx prsnet || fail "no labels"
}

# deploy/compose.yaml as it is, with an nginx image made here; an instance is killed under load, and comes back.
composed() {
  local public=$((port + 10)) killed=deploy_prsnet-1_1 began=$SECONDS
  printf 'FROM %s\nRUN apt-get update -qq && apt-get install -yqq --no-install-recommends nginx-light\n' "$base" \
    >"$state/Nginxfile"
  podman build -q --layers=false --network host -t localhost/nginx:check -f "$state/Nginxfile" "$state" >"$state/build.log" 2>&1 ||
    { tail -n 40 "$state/build.log"; fail "no image with nginx"; }
  podman tag "$image" localhost/prsnet:latest
  # no answer is kept: each request has a worker busy when an instance is killed
  printf 'services: {prsnet-1: &i {environment: {PRSNET_CACHE_BYTES: "0"}}, prsnet-2: *i}\n' >"$state/no-cache.yaml"
  export NGINX_IMAGE=localhost/nginx:check PORT=$public
  compose=(podman-compose -f deploy/compose.yaml -f "$state/no-cache.yaml")
  "${compose[@]}" up -d >"$state/compose.log" 2>&1 || { cat "$state/compose.log"; fail "compose.yaml does not start"; }
  until curl -fsS -m 2 "http://127.0.0.1:$public/health" >/dev/null 2>&1 &&
    [ "$(podman logs "$killed" deploy_prsnet-2_1 2>&1 | grep -c '"ready: ')" = 2 ]; do
    if [ "$((SECONDS - began))" -gt 90 ]; then cat "$state/compose.log"; fail "compose.yaml: not ready after 90 s"; fi
    sleep 0.5
  done
  step "compose.yaml: two instances and a proxy are ready"
  python3 benchmarks/proxy_kill.py "http://127.0.0.1:$public" tests/data/chair.obj --seconds 9 \
    --kill "kill -KILL $(podman inspect -f '{{.State.Pid}}' "$killed")" >"$state/killed" ||
    { cat "$state/killed"; podman logs deploy_proxy_1; fail "a request was lost with an instance"; }
  step "one of two instances killed under load: $(cat "$state/killed")"
  began=$SECONDS
  until [ "$(podman inspect -f '{{.State.Running}}' "$killed")" = true ]; do
    if [ "$((SECONDS - began))" -gt 30 ]; then fail "the instance that was killed does not come back"; fi
    sleep 0.5
  done
  step "the instance that was killed runs again"
  head -c 70000000 /dev/zero >"$state/large.stl"
  curl -sS -m 60 -F "file=@$state/large.stl" "http://127.0.0.1:$public/detect" >"$state/refused"
  grep -q 'problems/upload-too-large' "$state/refused" || fail "a large upload got: $(head -c 300 "$state/refused")"
}

trap finish EXIT
install_engine
configure_engine
build
start
hardened
described
detects
composed
stops
step "passed"
