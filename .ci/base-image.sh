#!/usr/bin/env bash
# base-image.sh OUT.tar: a root file system that stands in for the Dockerfile's default base image where no image
# registry is reachable: the host's Debian release, its Python, pip and venv, and the host's trust in certificates.
set -euo pipefail

archive=${1:?usage: base-image.sh OUT.tar}
release=$(. /etc/os-release && printf %s "$VERSION_CODENAME")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Runs on the host with the new root as $1, once its packages are installed.
cat >"$work/finish" <<'HOOK'
#!/bin/sh
set -eu
root=$1
# the names the official image has
for name in python python3; do ln -sf /usr/bin/python3 "$root/usr/local/bin/$name"; done
rm -f "$root"/usr/lib/python3*/EXTERNALLY-MANAGED
# certificate authorities that the host's administrator added
if ls /usr/local/share/ca-certificates/*.crt >/dev/null 2>&1; then
  cp /usr/local/share/ca-certificates/*.crt "$root/usr/local/share/ca-certificates/"
fi
chroot "$root" update-ca-certificates >/dev/null 2>&1
# a mirror may be older than its own expiry date says; keep no package files
printf '%s\n' 'Acquire::Check-Valid-Until "false";' 'APT::Keep-Downloaded-Packages "false";' \
  'Dir::Cache::pkgcache "";' 'Dir::Cache::srcpkgcache "";' >"$root/etc/apt/apt.conf.d/90image"
rm -f "$root/etc/resolv.conf" "$root/etc/hostname" "$root"/var/cache/apt/*.bin
HOOK
chmod +x "$work/finish"

sources=/etc/apt/sources.list.d/debian.sources
[ -f "$sources" ] || sources=/etc/apt/sources.list
mmdebstrap --quiet --variant=minbase \
  --include=ca-certificates,netbase,tzdata,python3-minimal,python3-venv,python3-pip \
  --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*' \
  --dpkgopt='path-exclude=/usr/share/locale/*' \
  --customize-hook="$work/finish" "$release" "$archive" "$sources"
