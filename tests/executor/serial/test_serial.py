"""The serial driver against a fake controller on a pseudo-terminal, and its faults."""

from __future__ import annotations

import json
import os
import pty
import re
import textwrap
import threading
import time
import tty
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.station import Station
from microplan.executor.devices.station_file import read_station
from microplan.executor.devices.timeouts import WallClock
from microplan.executor.motion.motion import Motion
from microplan.executor.serial.devices import Controller
from microplan.executor.serial.link import (
    LONGEST,
    TRIES,
    Answer,
    Link,
    Port,
    answer,
    crc8,
    question,
)
from microplan.executor.simulated.cell import build_cell
from microplan.executor.testing import Bench, conforms
from microplan.schemas.codec import to_data
from tests.executor.bench import quiet, world
from tests.executor.serial.fake_controller import FAULTS, FakeController, _check, _line

LIMITS: dict[str, Any] = {
    "magnification": (1.0, 44.5),
    "focus_um": (-500.0, 500.0),
    "opening_um": (0.0, 200.0),
}
BEYOND = {"magnification": 45.0, "focus_um": -501.0, "opening_um": 201.0}
STEP = {"magnification": 5.0, "focus_um": 20.0, "opening_um": 10.0}  # 50 ms each
# code -> the faults that end in it, "" for those that do no harm
ENDS = {
    "": (
        "silent_once", "corrupt_once", "split", "noise", "flood", "echo", "twice",
        "late_once",
    ),
    "MP841": ("refuses", "words", "text", "unplugged"),
    "MP844": ("silent", "corrupt", "cut", "late", "other"),
    "MP845": ("stuck",),
    "MP847": ("nan",),
}  # fmt: skip
CODES = {fault: code for code, faults in ENDS.items() for fault in faults}
# jaws that open are then neither there nor on a part
SHORT = {"zoom": "MP845", "focus": "MP845", "jaws": "MP849"}
MOTIONS: dict[str, tuple[Callable[..., object], float]] = {
    "zoom": (Motion.zoom, 20.0),
    "focus": (Motion.focus, 60.0),
    "jaws": (Motion.grip, 150.0),
}


@pytest.fixture
def fake() -> Iterator[FakeController]:
    with FakeController() as made:
        yield made


def controller(fake: FakeController, answer_s: float = 0.2) -> Controller:
    return Controller(port=fake.path, answer_s=answer_s, **LIMITS)


def station(found: Controller) -> Station:
    """Return a station whose lens and jaws are the controller's."""
    cell = build_cell(quiet(world()), 0)
    rules = replace(cell.station.rules, drive_timeout_s=0.5)
    return replace(
        cell.station,
        lens=found.lens,
        gripper=found.jaws,
        clock=WallClock(),
        rules=rules,
    )


@pytest.mark.parametrize("role", ["lens", "jaws"])
def test_the_drivers_do_what_they_must(role: str, fake: FakeController) -> None:
    found = controller(fake)
    conforms(getattr(found, role), role, Bench(beyond=BEYOND, step=STEP))
    assert not fake.moving()
    found.close()


@pytest.mark.parametrize("role", MOTIONS)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_line_ends_in_its_code_and_everything_stands(
    fault: str, role: str, fake: FakeController
) -> None:
    wanted = SHORT[role] if fault == "short" else CODES[fault]
    # what is waited for in vain need not be waited for long
    found, motion = controller(fake, 0.05 if wanted == "MP844" else 0.2), Motion()
    where, (move, goal) = station(found), MOTIONS[role]
    fake.inject(fault)
    code = ""
    try:
        move(motion, where, goal)
    except ExecutorError as error:
        code = error.code
    assert code == wanted
    assert not fake.moving()
    if code:
        with pytest.raises(ExecutorError) as later:
            motion.zoom(where, 10.0)
        assert later.value.code == code  # nothing moves after a fault
    elif role == "jaws":
        assert found.jaws.reading() == goal
    else:
        assert goal in found.lens.reading()
    found.close()


def test_every_fault_has_its_code_and_its_row_in_the_documentation() -> None:
    assert set(CODES) | {"short"} == set(FAULTS)
    page = (Path(__file__).parents[3] / "docs" / "drivers.md").read_text("utf-8")
    for fault, what in FAULTS.items():
        code = CODES.get(fault, "MP845; jaws MP849") or "none"
        assert f"| `{fault}` | {what} | {code} |" in page


def test_the_documented_hub_is_one_of_a_station_file(
    fake: FakeController, tmp_path: Path
) -> None:
    root = Path(__file__).parents[3]
    page = (root / "docs" / "drivers.md").read_text("utf-8")
    block = page[page.index("    [hubs.controller]") :].split("\n\n    [devices]")[0]
    text = (root / "examples" / "stations" / "simulated.toml").read_text("utf-8")
    text = text.replace("[devices]", textwrap.dedent(block) + "\n[devices]", 1)
    text = text.replace("/dev/ttyUSB0", fake.path)
    for role in ("lens", "jaws"):
        text = text.replace(
            f'{role} = {{ hub = "cell" }}', f'{role} = {{ hub = "controller" }}'
        )
    (tmp_path / "station.toml").write_text(text, encoding="utf-8")
    (tmp_path / "world.json").write_text(json.dumps(to_data(world())), encoding="utf-8")
    loaded = read_station(tmp_path / "station.toml", tmp_path)
    told = loaded.station.devices()
    assert told["lens"] == "fake-zoom-3 SN17 lens"
    assert told["jaws"] == "fake-zoom-3 SN17 jaws"
    loaded.hubs["controller"].close()


def test_a_late_answer_is_not_taken_for_the_next_one(fake: FakeController) -> None:
    found = controller(fake)
    fake.inject("late_once")
    assert found.lens.reading() == (6.9, 0.0)  # asked again: the first answer came late
    found.jaws.start(140.0)
    while found.jaws.moving():
        time.sleep(0.01)
    assert (found.jaws.reading(), *found.lens.reading()) == (140.0, 6.9, 0.0)
    assert fake.orders == ["go jaws 140.000000"]
    found.close()


def test_an_order_that_was_lost_is_asked_again_and_done_once(
    fake: FakeController,
) -> None:
    found = controller(fake)
    fake.inject("silent_once")
    found.jaws.start(140.0)
    assert fake.orders == ["go jaws 140.000000"] * 2  # a state: twice is once
    found.close()


def test_a_stop_does_not_wait_for_somebody_elses_answer() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    link = Link(Port(os.ttyname(slave)), answer_s=2.0)
    answers: dict[str, object] = {}

    def ask(word: str) -> threading.Thread:
        def work() -> None:
            answers[word] = link.ask(word)

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        return thread

    slow = ask("at")
    first = os.read(master, 100)
    stop = ask("stop")
    second = os.read(master, 100)  # blocks for ever if the stop waits
    os.write(master, _line(second[1:3] + b" ok"))
    stop.join(1.0)
    assert answers == {"stop": ()}
    os.write(master, _line(first[1:3] + b" ok 1 0"))
    slow.join(1.0)
    assert answers == {"stop": (), "at": ("1", "0")}
    link.close()
    os.close(master)
    os.close(slave)


def test_noise_without_end_is_given_up_in_time(fake: FakeController) -> None:
    link = Link(Port(fake.path), answer_s=0.05)
    fake.inject("flood")
    fake.inject("silent")
    began_s = time.monotonic()
    with pytest.raises(ExecutorError, match="did not answer 'id' in 3 tries"):
        link.ask("id")
    assert time.monotonic() - began_s < TRIES * 0.05 + 1.0
    link.close()


def test_a_port_that_is_no_port_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("", encoding="utf-8")
    with pytest.raises(OSError, match="is no serial port"):
        Controller(port=str(path), **LIMITS)
    with pytest.raises(FileNotFoundError):
        Controller(port=str(tmp_path / "none"), **LIMITS)


@pytest.mark.parametrize(
    "change",
    [
        {"baud": 1}, {"answer_s": float("nan")}, {"opening_um": (1.0, 1.0)},
        {"focus_um": (0.0,)}, {"focus_um": (0.0, float("inf"))},
    ],
)  # fmt: skip
def test_options_that_make_no_sense_are_refused(
    change: dict[str, Any], fake: FakeController
) -> None:
    with pytest.raises(ValueError, match=r"."):
        Controller(**{"port": fake.path, **LIMITS, **change})


def test_the_checksum_is_the_published_crc_8() -> None:
    assert crc8(b"123456789") == 0xF4  # "CRC-8/SMBUS" in catalogues of CRCs


@given(st.binary(min_size=1, max_size=LONGEST))
def test_both_ends_compute_the_same_checksum(body: bytes) -> None:
    assert b"%02X" % crc8(body) == _check(body)


WORDS = st.lists(st.from_regex(r"[a-zA-Z0-9.+-]{1,8}", fullmatch=True), max_size=5)


@given(st.integers(0, 255), WORDS, st.binary(max_size=20))
def test_an_answer_is_read_whatever_noise_comes_before(
    number: int, words: list[str], noise: bytes
) -> None:
    body = " ".join([f"{number:02X} ok", *words]).encode("ascii")
    found = answer(noise.replace(b"\n", b"") + _line(body))
    assert found == Answer(number, True, tuple(words))


@given(st.integers(0, 255), WORDS, st.data())
def test_no_line_with_a_flipped_bit_is_an_answer(
    number: int, words: list[str], data: st.DataObject
) -> None:
    line = bytearray(_line(" ".join([f"{number:02X} ok", *words]).encode("ascii")))
    bit = data.draw(st.integers(0, 8 * (len(line) - 2) - 1))  # the line's end aside
    line[bit // 8] ^= 1 << bit % 8
    assert answer(bytes(line)) is None


@given(st.binary(max_size=200))
def test_noise_is_no_answer_and_no_error(noise: bytes) -> None:
    found = answer(noise)
    assert found is None or b"<" in noise


def test_the_lines_of_the_documentation_have_right_checksums() -> None:
    page = (Path(__file__).parents[3] / "docs" / "drivers.md").read_text("utf-8")
    lines = re.findall(r"^    ([<>])(\w\w .*)\*(..)$", page, re.MULTILINE)
    assert len(lines) == 6
    for _, body, checksum in lines:
        assert _check(body.encode("ascii")).decode("ascii") == checksum


def test_words_that_cannot_be_sent_are_refused() -> None:
    for word in ("", "a b", "a*", "a\n", "é"):
        with pytest.raises(ValueError, match="cannot be sent"):
            question(0, [word])
    with pytest.raises(ValueError, match="at most 96"):
        question(0, ["a" * 100])
    assert question(256 + 10, ["at", "zoom"])[:11] == b">0A at zoom"
