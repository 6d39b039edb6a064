#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
#
# Installs what is missing of the named sets of deploy/packages.txt, with apt-get; does nothing, and needs
# no rights, where nothing is missing.
#
#   deploy/install_packages.sh build [test] [bench] [lint]
#   deploy/install_packages.sh run
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"

if [ $# -eq 0 ]; then
  echo "usage: $0 build|test|bench|lint|run ..." >&2
  exit 2
fi

missing=()
for set in "$@"; do
  packages=$(awk -v set="$set" '$1 == set { print $2 }' "$here/packages.txt")
  if [ -z "$packages" ]; then
    echo "error: deploy/packages.txt has no set \"$set\"" >&2
    exit 2
  fi
  for package in $packages; do
    status=$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null || true)
    [ "$status" = installed ] || missing+=("$package")
  done
done
[ ${#missing[@]} -gt 0 ] || exit 0

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  if ! command -v sudo >/dev/null; then
    echo "error: these packages are missing, and this is neither root nor is there sudo:" >&2
    echo "  ${missing[*]}" >&2
    echo "Run as root: apt-get install ${missing[*]}" >&2
    exit 1
  fi
  as_root=(sudo)
  [ -t 0 ] || as_root+=(-n) # Nobody is there to type a password.
fi

echo "Installing: ${missing[*]}"
apt=(env DEBIAN_FRONTEND=noninteractive apt-get -q -y -o DPkg::Lock::Timeout=300)
"${as_root[@]}" "${apt[@]}" update </dev/null
"${as_root[@]}" "${apt[@]}" install --no-install-recommends "${missing[@]}" </dev/null
