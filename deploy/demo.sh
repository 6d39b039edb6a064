#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
#
# From a clone to pictures: it installs what is missing, builds Release, starts a server on a free port of the
# loopback interface, loads a scene, streams the tiles of a 1920×1080 camera and the shadows of three
# lights at every hit, prints one table, and leaves in out/
#
#   lit.png     the view with its shadows
#   depth.png   the distance to what is seen
#   cost.png    the work per tile
#
#   deploy/demo.sh                     the built-in columned hall
#   deploy/demo.sh builtin:forest      another built-in scene
#   deploy/demo.sh bunny.ply           a file: OBJ, PLY, STL, OFF, glTF, GLB and more, also .xz and .gz
set -euo pipefail
root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"

if [ $# -gt 1 ] || [ "${1:-}" = --help ] || [ "${1:-}" = -h ]; then
  sed -n '4,15s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"
  [ $# -le 1 ] && exit 0 || exit 2
fi
scene="${1:-builtin:hall}"
case "$scene" in
  builtin:*) ;;
  *)
    if [ ! -r "$scene" ]; then
      echo "error: $scene: no such file, or not readable" >&2
      exit 2
    fi
    ;;
esac
out="$root/out"

"$root/deploy/install_packages.sh" build

# What a build says is of interest only when it fails.
mkdir -p "$root/build"
log="$root/build/demo.log"
echo "Building Release (the first time takes several minutes; progress in build/demo.log)"
build() { (cd "$root" && cmake --preset demo && cmake --build --preset demo --parallel "$(nproc)"); }
if ! build </dev/null >"$log" 2>&1; then
  tail -n 40 "$log" >&2
  echo "error: the build failed; all of it is in $log" >&2
  exit 1
fi

state="$(mktemp -d)"
server=""
cleanup() {
  if [ -n "$server" ] && kill -TERM "$server" 2>/dev/null; then wait "$server" || true; fi
  rm -rf "$state"
}
trap cleanup EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

"$root/build/release/bin/sightlined" --listen 127.0.0.1:0 --port-file "$state/port" \
  </dev/null >"$state/server.log" 2>&1 &
server=$!
# The port file appears, whole, once the server accepts calls.
for ((i = 0; i < 300; i++)); do
  [ ! -s "$state/port" ] || break
  kill -0 "$server" 2>/dev/null || break
  sleep 0.1
done
if [ ! -s "$state/port" ]; then
  cat "$state/server.log" >&2
  echo "error: the server did not start" >&2
  exit 1
fi

mkdir -p "$out"
"$root/build/release/bin/sightline" view "$scene" --server "127.0.0.1:$(cat "$state/port")" \
  --size 1920x1080 --stats \
  --out "lit:$out/lit.png" --out "depth:$out/depth.png" --out "cost:$out/cost.png"
echo "Pictures: out/lit.png, out/depth.png, out/cost.png"
