#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
#
# Writes corpus/scene_file, the seeds of fuzz_scene_file: small scenes by each way of building, behind the byte
# that asks for the sums to be made right. Run it again when the format changes.
#
#   make_scene_file_corpus.sh build/release/bin/sightline
set -euo pipefail
sightline="$(realpath "${1:?the path of sightline}")"
cd "$(dirname "${BASH_SOURCE[0]}")"
out="corpus/scene_file"
rm -rf "$out"
mkdir -p "$out"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT

# seed NAME FLAGS...: of $work/mesh.obj.
seed() {
  "$sightline" import "$work/mesh.obj" -o "$work/scene.slscene" "${@:2}" >/dev/null
  {
    printf '0'
    cat "$work/scene.slscene"
  } >"$out/$1"
}

cat >"$work/mesh.obj" <<'END'
o floor
v 0 0 0
v 4 0 0
v 4 4 0
v 0 4 0
f 1 2 3 4
o odd
v 1 1 1
v nan 0 0
v 2 1 1
f 5 6 7
f 5 5 7
f 1 2 3
END
seed few
seed few_compact --build compact
seed few_kd --structure kd-tree --binary-bvh

awk 'BEGIN {
  for (i = 0; i < 60; ++i) {
    x = i % 8; y = int(i / 8)
    printf "v %d %d %g\nv %d %g %d\nv %g %d %d\nf -3 -2 -1\n", x, y, (i * 7 % 5) / 4, x + 1, y, i % 3, x, y + 1, i % 2
  }
}' >"$work/mesh.obj"
seed many
seed many_compact --build compact
seed many_dynamic --build dynamic
seed many_kd --structure kd-tree --kd-lay-out-leaves
seed many_both --structure both --kd-perfect-splits --binary-bvh
