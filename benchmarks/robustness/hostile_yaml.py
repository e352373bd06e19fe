"""Hostile task files: bombs, odd text, and much of everything."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from benchmarks.robustness.hostile_task import FINE, Case, task, task_text

_SIZE = 1 << 20  # what is read of a task


def cases() -> Iterator[Case]:
    """Yield all hostile task files."""
    yield from _bombs()
    yield from _text()
    yield from _many()
    yield from _values()


def _bombs() -> Iterator[Case]:
    laughs = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    for k in range(1, 12):
        nine = ", ".join([f"*a{k - 1}"] * 9)
        laughs.append(f"a{k}: &a{k} [{nine}]")
    yield task("YAML, a billion laughs", "\n".join(laughs) + "\n" + task_text())
    yield task("YAML, an anchor that holds itself", "&a [*a]\n")
    yield task("YAML, merged keys", task_text() + "x: &x {a: 1}\ny: {<<: *x}\n")
    yield task("YAML, a tag that calls", "!!python/object/apply:os.system ['true']\n")
    for depth in (33, 1000, 100_000):
        yield task(f"YAML, {depth} brackets", "[" * depth)
        yield task(f"YAML, {depth} closed brackets", "[" * depth + "]" * depth)
        yield task(f"YAML, {depth} braces", "{a: " * depth)
        yield task(f"YAML, {depth} dashes", "- " * depth + "x\n")
        yield task(f"YAML, {depth} question marks", "? " * depth + "x\n")
    yield task("YAML, 1000 levels by indent", "".join(
        " " * k + "a:\n" for k in range(1000)
    ))  # fmt: skip
    yield task("YAML, 100000 documents", "---\n" * 100_000)
    yield task("YAML, 300000 commas", "[" + "," * 300_000 + "]\n")
    yield task("YAML, 300000 quotes", "'" * 300_000 + "\n")
    yield task("YAML, 100000 anchors", "".join(
        f"k{k}: &a{k} 1\n" for k in range(60_000)
    ))  # fmt: skip
    yield task("YAML, 100000 directives", "%YAML 1.2\n" * 90_000)


def _text() -> Iterator[Case]:
    good = task_text()
    yield task("YAML, empty", b"")
    yield task("YAML, zeros", bytes(4096))
    yield task("YAML, blank lines", b"\n" * _SIZE)
    yield task("YAML, comments", b"#\n" * (_SIZE // 2))
    yield task("YAML, spaces", b" " * _SIZE)
    yield task("YAML, a tab first", "\t" + good)
    yield task("YAML in Latin-1", good.replace("hostile", "größe").encode("latin-1"))
    yield task("YAML in UTF-16", good.encode("utf-16"))
    yield task("YAML in UTF-32", good.encode("utf-32"))
    yield task("YAML, a NUL in it", good.replace("hostile", "hos\0tile"))
    yield task("YAML, a control character", good.replace("hostile", "hos\x1btile"))
    yield task("YAML, a lone surrogate", good.replace("hostile", "hos\ud800tile"))
    yield task("YAML, escaped", good.replace("hostile", r'"\ud800\x1b[2J\0"'))
    yield task(
        "YAML, escaped in a path", good.replace("parts/part.dxf", r'"a\ud800\0"')
    )
    yield task("YAML, a line separator", good.replace("hostile", "hos\u2028tile"))
    yield task("YAML, right to left", good.replace("hostile", "\u202egnp.exe"))
    yield task("a PNG as a task", b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 16)
    yield task("HTML as a task", "<!DOCTYPE html><html><body>no</body></html>")
    yield task("JSON as a task", '{"microplan": 1, "parts": []}')
    yield task("more than 1 MiB of YAML", b"#" * (_SIZE + 1))


def _many() -> Iterator[Case]:
    good = task_text()
    yield task("YAML, 40000 unknown keys", good + "".join(
        f"k{k}: 1\n" for k in range(40_000)
    ))  # fmt: skip
    yield task("YAML, 40000 unknown keys in a line", good + "x: {" + ", ".join(
        f"k{k}: 1" for k in range(40_000)
    ) + "}\n")  # fmt: skip
    yield task("YAML, 20000 unknown keys of a part in a line", good.replace(
        "{file: parts/part.dxf",
        "{" + "".join(f"k{k}: 1, " for k in range(20_000)) + "file: parts/part.dxf",
    ))  # fmt: skip
    yield task("YAML, 40000 equal keys", good + "k: 1\n" * 40_000)
    yield task("YAML, 40000 equal keys in a line", good + "x: {"
               + "k: 1, " * 40_000 + "}\n")  # fmt: skip
    yield task("YAML, 40000 infinities in a line", good + "x: ["
               + ".inf, " * 40_000 + "]\n")  # fmt: skip
    yield task("YAML, 49000 numbers", good + "x: [" + "1, " * 49_000 + "]\n")
    yield task("YAML, 100000 numbers", good + "x: [" + "1, " * 100_000 + "]\n")
    look = "  - {id: look, do: locate, target: part}\n"
    yield task("YAML, 8000 equal steps", good + look * 8000)
    yield task("YAML, 8000 steps", good + "".join(
        look.replace("look", f"look{k}", 1) for k in range(8000)
    ), statuses=FINE)  # fmt: skip
    yield task("YAML, 8000 steps of lost names", good + "".join(
        f"  - {{id: look{k}, do: locate, target: nobody{k}}}\n" for k in range(8000)
    ))  # fmt: skip
    yield task("YAML, 12000 empty steps", good + "  - {}\n" * 12_000)
    for name, make in _PARTS.items():
        yield task(name, make, statuses=FINE)


def _parts(count: int) -> str:
    """Return a task of many parts, all from one file that is not there."""
    one = "  p{k}: {{drawing: {{file: parts/none.dxf, units: um, layers: [A]}}, "
    one += "thickness_um: 1, reflectance: 0.5}}\n"
    good = task_text()
    at = good.index("start:\n")
    return good[:at] + "".join(one.format(k=k) for k in range(count)) + good[at:]


def _features(count: int) -> str:
    """Return a task whose part has many features."""
    many = "".join(f"      f{k}: {{kind: circle, layer: L{k}}}\n" for k in range(count))
    good = task_text()
    at = good.index("start:\n")
    return good[:at] + "    features:\n" + many + good[at:]


_PARTS: dict[str, Callable[[], str]] = {
    "YAML, 60 parts that are not there": lambda: _parts(60),
    "YAML, 5000 parts": lambda: _parts(5000),
    "YAML, 6000 features": lambda: _features(6000),
}


def _values() -> Iterator[Case]:
    good = task_text()
    large = "x" * (_SIZE - 2000)
    yield task("YAML, a key of 1 MiB", good + f"{large}: 1\n")
    yield task("YAML, a quoted key of 1 MiB", good + f'"{large}": 1\n')
    yield task("YAML, a name of 1 MiB", good.replace("hostile", large))
    yield task(
        "YAML, a target of 1 MiB", good.replace("target: part", f"target: {large}")
    )
    yield task("YAML, a verb of 1 MiB", good.replace("do: locate", f"do: {large}"))
    yield task("YAML, a unit of 1 MiB", good.replace("units: um", f"units: {large}"))
    yield task("YAML, a file name of 1 MiB", good.replace("parts/part.dxf", large))
    yield task("YAML, a comment of 1 MiB beside a mistake",
               good.replace("seed: 1", "sead: 1 #" + large))  # fmt: skip
    yield task("YAML, a text of 1 MiB in a block", good + "x: |\n" + (
        "  line\n" * ((_SIZE - 3000) // 7)
    ))  # fmt: skip
    for value in (
        "0x" + "f" * 300, "0x" + "f" * 500_000, "0o" + "7" * 500_000, "9" * 500_000,
        "1e999999", "-1e999999", ".nan", "-.inf", "1e308", "-1e308", "1e-320",
        "9" * 300, "0." + "0" * 500_000 + "1", "1_000", "0x10", "010", "1:30",
        "true", "null", "[]", "{}", "~", "''", "2001-01-01",
    ):  # fmt: skip
        short = value if len(value) < 20 else f"{value[:6]}... of {len(value)}"
        allowed = FINE
        yield task(f"YAML, thickness {short}",
                   good.replace("thickness_um: 10", f"thickness_um: {value}"),
                   statuses=allowed)  # fmt: skip
        yield task(f"YAML, x {short}",
                   good.replace("on: stage, x_um: 0", f"on: stage, x_um: {value}"),
                   statuses=allowed)  # fmt: skip
        yield task(f"YAML, seed {short}", good.replace("seed: 1", f"seed: {value}"),
                   statuses=allowed)  # fmt: skip
        yield task(f"YAML, version {short}",
                   good.replace("microplan: 1", f"microplan: {value}"),
                   statuses=allowed)  # fmt: skip
        yield task(f"YAML, spread {short}",
                   good.replace("sigma_xy_um: 2", f"sigma_xy_um: {value}"),
                   statuses=allowed)  # fmt: skip
        yield task(f"YAML, name {short}",
                   good.replace("name: hostile", f"name: {value}"),
                   statuses=allowed)  # fmt: skip
