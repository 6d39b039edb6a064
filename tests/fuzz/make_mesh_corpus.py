#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the seed corpus of fuzz_mesh_readers: corpus/mesh/*, a few hundred bytes each.

The first byte of a seed chooses the reader (see fuzz_mesh_readers.cc), the rest is the file.
"""
import base64
import gzip
import json
import lzma
import os
import struct

FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "corpus", "mesh")


def seed(name, reader, data):
    with open(os.path.join(FOLDER, name), "wb") as f:
        f.write(reader.encode() + (data if isinstance(data, bytes) else data.encode()))


OBJ = """# corners in every form
mtllib none.mtl
o house
v 447422.999 -1.5e-3 +.5
v 1 0 0 1
v nan inf 1.#IND
v 0 1 0
vt 0 0
vn 0 0 1
usemtl wall
s off
f 1 2 4
f 1/1 2/1 4/1
f 1//1 2//1 4//1
g roof left
f -4 -3 -2 \\
  -1
f 0 1 2
f 1 2
f 1 2 99999999999
p 1
l 1 2
g
f 1// 2// 3//
"""
PLY_HEAD = """ply
format %s 1.0
comment seed
element vertex 4
property double x
property double y
property double z
property uchar red
element edge 1
property int vertex1
property int vertex2
element face 2
property list uchar int vertex_indices
property float quality
end_header
"""
POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (447422.999, 1, 0)]
TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)


def ply_binary(order):
    out = b"".join(struct.pack(order + "dddB", *p, 7) for p in POINTS)
    out += struct.pack(order + "ii", 0, 1)
    out += struct.pack(order + "B4if", 4, 0, 1, 2, 3, 1.0)
    return out + struct.pack(order + "B3if", 3, 0, 1, 9, 1.0)


def gltf(uri, quantized=False):
    """One triangle, used by two nodes, with a sparse copy of it and a line."""
    buffer = struct.pack("<4H", 0, 1, 2, 0) + TRIANGLE + struct.pack("<2H", 1, 0)
    buffer += struct.pack("<3f", 5, 5, 5)
    shorts = struct.pack("<12h", 0, 0, 0, 0, 32767, 0, 0, 0, 0, 32767, 0, 0)
    buffer += shorts
    views = [(0, 8), (8, 36), (44, 4), (48, 12), (60, 24)]
    doc = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": "root", "children": [1, 2], "translation": [1, 2, 3]},
            {"mesh": 0, "rotation": [0, 0, 0.6, 0.8], "scale": [1, 2, -3]},
            {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 4, 5, 6, 1]},
        ],
        "meshes": [{"name": "m", "primitives": [
            {"attributes": {"POSITION": 1}, "indices": 0},
            {"attributes": {"POSITION": 3}, "mode": 5},
            {"attributes": {"POSITION": 1}, "mode": 1, "indices": 0},
        ]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5123, "count": 3, "type": "SCALAR"},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 4, "componentType": 5122, "count": 3, "type": "VEC3",
             "normalized": True},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3", "sparse": {
                "count": 1, "indices": {"bufferView": 2, "componentType": 5123},
                "values": {"bufferView": 3}}},
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": o, "byteLength": n} for o, n in views],
        "buffers": [{"byteLength": len(buffer)}],
    }
    doc["bufferViews"][4]["byteStride"] = 8
    if quantized:
        doc["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 2}, "mode": 6}]
    if uri:
        doc["buffers"][0]["uri"] = (
            "data:application/octet-stream;base64," + base64.b64encode(buffer).decode())
    return json.dumps(doc, separators=(",", ":")), buffer


def glb(quantized=False):
    text, buffer = gltf(False, quantized)
    data = text.encode()
    data += b" " * (-len(data) % 4)
    buffer += b"\0" * (-len(buffer) % 4)
    chunks = struct.pack("<II", len(data), 0x4E4F534A) + data
    chunks += struct.pack("<II", len(buffer), 0x004E4942) + buffer
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def scene_wire():
    """A scene of one triangle as scene_wire.h sends it."""
    def run(data, count):
        return struct.pack("<Q", count) + data
    out = run(b"assimp 3ds", 10)
    for value in (1, 0, 0, 0, 0, 0):
        out += run(struct.pack("<Q", value), 1)
    out += run(struct.pack("<Q", 1), 1) + run(b"box", 3)
    out += run(struct.pack("<9d", 0, 0, 0, 1, 0, 0, 0, 1, 0), 3)
    out += run(struct.pack("<3I", 0, 1, 2), 3)
    return out + run(struct.pack("<12d", 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0), 96)


def main():
    os.makedirs(FOLDER, exist_ok=True)
    seed("obj", "0", OBJ)
    ascii_body = "0 0 0 7\n1 0 0 7\n1 1 0 7\n447422.999 1 nan 7\n0 1\n4 0 1 2 3 1\n3 0 1 9 1\n"
    seed("ply_ascii", "1", PLY_HEAD % "ascii" + ascii_body)
    seed("ply_little", "1", (PLY_HEAD % "binary_little_endian").encode() + ply_binary("<"))
    seed("ply_big", "1", (PLY_HEAD % "binary_big_endian").encode() + ply_binary(">"))
    seed("ply_strips", "1", "ply\nformat ascii 1.0\nelement tristrips 1\n"
         "property list int int vertex_indices\nelement vertex 4\nproperty float z\n"
         "property float y\nproperty float x\nend_header\n"
         "8 0 1 2 3 -1 1 2 3\n0 0 0\n0 0 1\n0 1 0\n0 1 1\n")
    facet = ("facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n"
             "  vertex 0 447422.999 0\n endloop\nendfacet\n")
    seed("stl_ascii", "2", "solid A b\n" + facet + "endsolid A b\nSOLID\n" + facet + "endsolid\n")
    seed("stl_open_facet", "2", "solid A\nvertex 0 0 0\nvertex 1 0 0\nsolid B\n" + facet)
    seed("stl_binary", "2", b"solid".ljust(80) + struct.pack("<I", 2) +
         2 * (struct.pack("<3f", 0, 0, 1) + TRIANGLE + b"\0\0"))
    seed("off", "3", "OFF4 2 0 # run together\n0 0 0\n1 0 0\n1 1 0\n0 447422.999 0\n"
         "4 0 1 2 3 255 0 0\n3 0 1 9\n")
    seed("off_colours", "3", "CNOFF\n3 1 3\n0 0 0 0 0 1 9 9 9 255\n1 0 0 0 0 1 9 9 9 255\n"
         "0 1 0 0 0 1 9 9 9 255\n3 0 1 2 0.5 0.5 0.5\n")
    seed("gltf", "4", gltf(True)[0])
    seed("gltf_quantized", "4", gltf(True, True)[0])
    seed("glb", "5", glb())
    seed("glb_quantized", "5", glb(True))
    seed("xz", "6", lzma.compress(OBJ.encode(), check=lzma.CHECK_CRC32) +
         lzma.compress(b"f 1 2 4\n", check=lzma.CHECK_CRC64))
    seed("gz", "7", gzip.compress(OBJ.encode(), mtime=0) + gzip.compress(b"f 1 2 4\n", mtime=0))
    seed("scene", "8", scene_wire())


if __name__ == "__main__":
    main()
