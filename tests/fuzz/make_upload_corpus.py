#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the seed corpus of fuzz_uploads: corpus/uploads/*, a few dozen bytes each.

An input of that target is the choices that it makes, a byte each, the last one first, as LLVM's
FuzzedDataProvider takes integers of a range of up to 256 values: the byte is how far above the
least the choice is. A range of one value takes no byte.
"""
import os

FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "corpus", "uploads")

MESH, EDIT, POINTS = 0, 1, 2  # What is uploaded.
DROP, DOUBLE, EXCHANGE, CHANGE = 0, 1, 2, 3  # What is done to a message.
ADD, REPLACE, REMOVE, TRANSFORM = 0, 1, 2, 3  # Edits.


def seed(name, *choices):
    flat = []
    for choice in choices:
        flat.extend(choice if isinstance(choice, list) else [choice])
    with open(os.path.join(FOLDER, name), "wb") as f:
        f.write(bytes(reversed(flat)))


def chunks(vertices, triangles, floats, steps):
    """Of so many vertices and triangles; `steps`: (vertices, triangles) of each chunk, in turns."""
    choices, at = [1 if floats else 0], 0
    while vertices > 0 or triangles > 0:
        more = steps[at % len(steps)]
        at += 1
        choices.extend(more)
        if more == (0, 0):  # All the rest.
            break
        vertices -= min(vertices, more[0])
        triangles -= min(triangles, more[1])
    return choices


def mesh(vertices, triangles, floats=False, steps=((2, 1),)):
    indices = [i % vertices for i in range(3 * triangles)]
    return [vertices - 3, triangles - 1, *indices, *chunks(vertices, triangles, floats, steps)]


def edit(kind, *more):
    return [kind, *[byte for part in more for byte in part]]


def transform(*numbers):
    return [number + 4 for number in numbers]


def disturbances(*done):
    """(which message, what is done to it, for CHANGE also which of its bytes)."""
    return [len(done), *[byte for one in done for byte in one]]


NONE = disturbances()
SHIFT = transform(1, 0, 0, 3, 0, 1, 0, -2, 0, 0, 1, 4)

os.makedirs(FOLDER, exist_ok=True)
for old in os.listdir(FOLDER):
    os.remove(os.path.join(FOLDER, old))

seed("mesh", MESH, 0, mesh(3, 1), NONE)
seed("mesh_in_one_chunk", MESH, 0, mesh(12, 12, steps=((0, 0),)), NONE)
seed("meshes_of_floats", MESH, 2, mesh(4, 2, True), mesh(8, 5, True, ((4, 4),)), mesh(3, 12, True), NONE)
seed("mesh_indices_first", MESH, 0, mesh(6, 4, steps=((0, 3), (0, 1), (4, 0))), NONE)
seed("mesh_without_object", MESH, 0, mesh(3, 1), disturbances((1, DROP)))
seed("mesh_without_chunk", MESH, 0, mesh(6, 4), disturbances((3, DROP)))
seed("mesh_two_headers", MESH, 0, mesh(3, 1), disturbances((0, DOUBLE)))
seed("mesh_chunk_twice", MESH, 1, mesh(3, 1), mesh(5, 3), disturbances((2, DOUBLE)))
seed("mesh_late_header", MESH, 0, mesh(3, 1), disturbances((0, EXCHANGE)))
seed("mesh_other_count", MESH, 0, mesh(3, 1), disturbances((1, CHANGE, 11), (0, CHANGE, 3)))

seed("edit_add", EDIT, 0, edit(ADD, mesh(4, 2)), NONE)
seed("edit_replace", EDIT, 0, edit(REPLACE, [7], chunks(8, 0, False, ((3, 0),))), NONE)
seed("edit_remove", EDIT, 0, edit(REMOVE), NONE)
seed("edit_transform", EDIT, 0, edit(TRANSFORM, SHIFT), NONE)
seed("edit_all", EDIT, 3, edit(REMOVE), edit(ADD, mesh(5, 6, True, ((4, 4),))), edit(TRANSFORM, SHIFT),
     edit(REPLACE, [2], chunks(3, 0, True, ((1, 0),))), NONE)
seed("edit_none_left", EDIT, 0, edit(REMOVE), disturbances((1, DROP)))
seed("edit_cut_between", EDIT, 1, edit(ADD, mesh(6, 4)), edit(TRANSFORM, SHIFT), disturbances((3, DROP)))
seed("edit_chunk_after_transform", EDIT, 1, edit(ADD, mesh(3, 1)), edit(TRANSFORM, SHIFT), disturbances((2, EXCHANGE)))
seed("edit_replace_twice", EDIT, 0, edit(REPLACE, [3], chunks(4, 0, False, ((4, 0),))), disturbances((1, DOUBLE)))
seed("edit_other_part", EDIT, 1, edit(REMOVE), edit(TRANSFORM, SHIFT), disturbances((2, CHANGE, 0)))

# Points less one, normals, sources; then chunks of so many, less one.
seed("points", POINTS, 0, 0, 0, 0, NONE)
seed("points_with_all", POINTS, 19, 1, 1, 7, 7, 3, NONE)
seed("points_normals_missing_once", POINTS, 5, 1, 0, 2, 2, disturbances((2, CHANGE, 3)))
seed("points_chunk_twice", POINTS, 11, 0, 1, 5, 5, disturbances((1, DOUBLE)))
seed("points_too_few", POINTS, 39, 0, 0, 7, 7, 7, 7, 7, disturbances((5, DROP)))
