"""Damaged files of every format: bytes changed, counts changed, parts spliced, and archives repacked after it."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable
from typing import Any

from intact_files import FLAT, GZIPPED, ZIPPED, Rng, glb_of, gltf_parts, packed, zip_members

INTERESTING = (0, 1, 127, 128, 255, 256, 32767, 65535, 2**31 - 1, 2**31, 2**32 - 1)
NUMBERS = ("0", "-1", "3", "99", "nan", "-inf", "1e400", "1e-400", "0.5", "", "x", str(10**6), str(10**12), "9" * 40)
VALUES: tuple[Any, ...] = (0, -1, 1, 2, 7, 10**9, 10**15, 1e300, -0.5, True, None, "", "x", "../f", [], [0], [[1]], {})
Mutation = Callable[[bytearray, Rng], bytearray]
Damage = Callable[[Rng], bytes]


def flip_bits(content: bytearray, rng: Rng) -> bytearray:
    for at in rng.integers(0, len(content), size=int(rng.integers(1, 12))):
        content[at] ^= 1 << int(rng.integers(8))
    return content


def flip_early(content: bytearray, rng: Rng) -> bytearray:
    """Headers are short and matter most."""
    for at in rng.integers(0, min(len(content), 128), size=int(rng.integers(1, 4))):
        content[at] = int(rng.integers(256))
    return content


def truncate(content: bytearray, rng: Rng) -> bytearray:
    return content[: int(rng.integers(0, len(content)))]


def extend(content: bytearray, rng: Rng) -> bytearray:
    return content + rng.bytes(int(rng.integers(1, 300)))


def overwrite_integer(content: bytearray, rng: Rng) -> bytearray:
    end = min(len(content), 4 * len(content) if rng.random() < 0.3 else 256)
    width = int(rng.choice([2, 4, 8]))
    at = width * int(rng.integers(0, max(1, end // width)))
    content[at : at + width] = (int(rng.choice(INTERESTING)) % (1 << 8 * width)).to_bytes(width, "little")
    return content


def blank(content: bytearray, rng: Rng) -> bytearray:
    start, length = int(rng.integers(0, len(content))), int(rng.integers(1, 64))
    value = int(rng.choice([0, 255]))
    content[start : start + length] = bytes([value]) * len(content[start : start + length])
    return content


def cut_out(content: bytearray, rng: Rng) -> bytearray:
    start = int(rng.integers(0, len(content)))
    del content[start : start + int(rng.integers(1, 64))]
    return content


def repeat(content: bytearray, rng: Rng) -> bytearray:
    start, length = int(rng.integers(0, len(content))), int(rng.integers(1, 200))
    content[start:start] = content[start : start + length] * int(rng.integers(1, 4))
    return content


def change_digit(content: bytearray, rng: Rng) -> bytearray:
    """Numbers in text headers: another digit, or several more."""
    digits = [at for at in range(min(len(content), 4096)) if 48 <= content[at] <= 57]
    if digits:
        at = int(rng.choice(digits))
        content[at : at + 1] = str(int(rng.choice([0, 3, 9, 99, 10**6, 10**12, 10**30], p=None))).encode()
    return content


def change_number(content: bytearray, rng: Rng) -> bytearray:
    """A whole number or word of a text, anywhere in its beginning."""
    words = list(re.finditer(rb"[^\s,;\"<>=:]+", content[:4096]))
    if words:
        word = words[int(rng.integers(len(words)))]
        content[word.start() : word.end()] = str(rng.choice(NUMBERS)).encode()
    return content


def shuffle_lines(content: bytearray, rng: Rng) -> bytearray:
    lines = content.split(b"\n")
    one, other = rng.integers(0, len(lines), size=2)
    lines[one] = lines[other]
    return bytearray(b"\n".join(lines))


MUTATIONS: tuple[Mutation, ...] = (
    *(flip_bits, flip_early, truncate, extend, overwrite_integer, blank, cut_out, repeat),
    *(change_digit, change_number, shuffle_lines),
)


def mutate(content: bytes, rng: Rng) -> bytes:
    """One or two mutations."""
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 3))):
        if changed:
            changed = MUTATIONS[rng.integers(len(MUTATIONS))](changed, rng)
    return bytes(changed)


def splice(one: bytes, other: bytes, rng: Rng) -> bytes:
    """The beginning of a file and the end of another."""
    return one[: int(rng.integers(0, len(one) + 1))] + other[int(rng.integers(0, len(other) + 1)) :]


def change_leaf(tree: Any, rng: Rng) -> Any:
    """Another value, or none, at a random place of what JSON holds."""
    if isinstance(tree, dict | list) and tree and rng.random() < 0.9:
        keys = list(tree) if isinstance(tree, dict) else list(range(len(tree)))
        key = keys[int(rng.integers(len(keys)))]
        if rng.random() < 0.05:
            del tree[key]
        else:
            tree[key] = change_leaf(tree[key], rng)
        return tree
    return VALUES[int(rng.integers(len(VALUES)))]


def damaged_glb(rng: Rng) -> bytes:
    """Half of them with changed JSON, whose lengths are right."""
    scene, buffer = gltf_parts(rng)
    return glb_of(change_leaf(scene, rng), buffer) if rng.random() < 0.5 else mutate(glb_of(scene, buffer), rng)


def damaged_gltf(rng: Rng) -> bytes:
    scene, buffer = gltf_parts(rng)
    uri = "data:application/octet-stream;base64," + base64.b64encode(buffer).decode()
    scene["buffers"] = [{"byteLength": len(buffer), "uri": uri}]
    if rng.random() < 0.5:
        return json.dumps(change_leaf(scene, rng)).encode()
    return mutate(json.dumps(scene).encode(), rng)


def _flat(name: str) -> Damage:
    write = FLAT[name][1]

    def next_file(rng: Rng) -> bytes:
        return splice(write(rng), write(rng), rng) if rng.random() < 0.1 else mutate(write(rng), rng)

    return next_file


def _zipped(name: str) -> Damage:
    def next_file(rng: Rng) -> bytes:
        members = ZIPPED[name][1](rng)
        if rng.random() < 0.3:
            return mutate(zip_members(members), rng)
        victim = list(members)[int(rng.integers(len(members)))]
        content = members.pop(victim)
        if rng.random() < 0.95:
            members[victim] = _mutated_member(victim, content, rng)
        return zip_members(members)

    return next_file


def _mutated_member(name: str, content: bytes, rng: Rng) -> bytes:
    if name.endswith(".json") and rng.random() < 0.6:
        return json.dumps(change_leaf(json.loads(content), rng)).encode()
    return mutate(content, rng)


def _gzipped(name: str) -> Damage:
    write = GZIPPED[name][1]
    return lambda rng: packed(mutate(write(rng), rng)) if rng.random() < 0.6 else mutate(packed(write(rng)), rng)


DAMAGED: dict[str, tuple[str, Damage]] = {
    **{name: (FLAT[name][0], _flat(name)) for name in FLAT},
    **{name: (ZIPPED[name][0], _zipped(name)) for name in ZIPPED},
    **{name: (GZIPPED[name][0], _gzipped(name)) for name in GZIPPED},
    "glb": ("f.glb", damaged_glb),
    "gltf": ("f.gltf", damaged_gltf),
}
"""Name in a folder, and what gives the next damaged file of a format."""


def intact(name: str, rng: Rng) -> bytes:
    """A valid file of a format."""
    if name in FLAT:
        return FLAT[name][1](rng)
    if name in ZIPPED:
        return zip_members(ZIPPED[name][1](rng))
    if name in GZIPPED:
        return packed(GZIPPED[name][1](rng))
    scene, buffer = gltf_parts(rng)
    if name == "glb":
        return glb_of(scene, buffer)
    uri = "data:application/octet-stream;base64," + base64.b64encode(buffer).decode()
    scene["buffers"] = [{"byteLength": len(buffer), "uri": uri}]
    return json.dumps(scene).encode()
