"""How blocks end: pending acts are done once, by whatever way; files are complete or not there."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from interrupts import accept_interrupts

from topokit.ending import finally_do
from topokit.errors import InputError
from topokit.inputs.writing import completed_file

SCRIPT = """
import os, sys, threading, time
from topokit.ending import end_on_signals, finally_do, written_whole
end_on_signals()
def act(text):
    print(text, flush=True)
with finally_do(lambda: act("outer")), finally_do(lambda: 1 / 0), finally_do(lambda: act("inner")):
    {block}
print("not reached", flush=True)
"""
SWALLOWS = """
    print("ready", flush=True)
    while True:
        try:
            time.sleep(0.01)
        except BaseException:
            pass
"""
WRITES = """
    with written_whole():
        print("ready", flush=True)
        time.sleep(0.5)
        print("the rest", flush=True)
    time.sleep(100)
"""
NEVER_READY = """
    with written_whole():
        print("ready", flush=True)
        time.sleep(100)
"""
linux = pytest.mark.skipif(sys.platform == "win32", reason="processes cannot be sent these signals")


def ended(block: str, *signals: int) -> tuple[int, list[str], str]:
    """Exit code, lines and standard error of the script after signals."""
    with subprocess.Popen(
        [sys.executable, "-c", SCRIPT.format(block=block.strip())],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=accept_interrupts,
    ) as process:
        assert process.stdout is not None
        try:
            process.stdout.readline()
            for number in signals:
                process.send_signal(number)
                time.sleep(0.2)
            out, errors = process.communicate(timeout=60)
        finally:
            process.kill()
    return process.returncode, out.splitlines(), errors


@linux
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_does_the_pending_acts_even_where_interrupts_are_swallowed(name: str) -> None:
    number = getattr(signal, name)
    code, lines, errors = ended(SWALLOWS, number)
    assert (code, lines) == (128 + number, ["inner", "outer"])
    assert errors == f"topokit: ended by {name}; results that were written are whole.\n"


@linux
def test_a_signal_waits_until_a_result_is_written() -> None:
    assert ended(WRITES, signal.SIGINT)[:2] == (130, ["the rest", "inner", "outer"])


@linux
def test_a_second_signal_does_not_wait() -> None:
    started = time.monotonic()
    code, lines, errors = ended(NEVER_READY, signal.SIGINT, signal.SIGTERM)
    assert (code, lines) == (130, [])
    assert "twice" in errors
    assert time.monotonic() - started < 50


@linux
def test_signals_that_are_ignored_stay_ignored() -> None:
    script = "import os, signal; from topokit.ending import end_on_signals; signal.signal(1, signal.SIG_IGN)\n"
    script += "end_on_signals(); os.kill(os.getpid(), 1); print('alive')"
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True).stdout == "alive\n"


def test_an_act_is_done_once_when_its_block_is_left() -> None:
    done = []
    with finally_do(lambda: done.append("act")):
        assert not done
    with pytest.raises(KeyError), finally_do(lambda: done.append("after an error")):
        raise KeyError
    assert done == ["act", "after an error"]


def test_a_file_appears_when_it_is_complete(tmp_path: Path) -> None:
    target = tmp_path / "out.txt"
    with completed_file(target) as unfinished:
        unfinished.write_text("new")
        assert not target.exists()
        assert unfinished.suffix == ".txt"
    assert target.read_text() == "new"
    with pytest.raises(ZeroDivisionError), completed_file(target) as unfinished:
        unfinished.write_text(f"half {1 / 0}")
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


@linux
def test_links_and_permissions_of_a_replaced_file_stay(tmp_path: Path) -> None:
    target, link = tmp_path / "out.txt", tmp_path / "link.txt"
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to(target)
    with completed_file(link) as unfinished:
        unfinished.write_text("new")
    assert link.is_symlink()
    assert (target.read_text(), target.stat().st_mode & 0o777) == ("new", 0o640)


@linux
def test_what_is_no_file_is_written_directly(tmp_path: Path) -> None:
    with completed_file("/dev/null") as unfinished:
        assert unfinished == Path("/dev/null")
    assert Path("/dev/null").is_char_device()


@linux
def test_a_full_disk_and_a_folder_without_permission_are_clear_errors(tmp_path: Path) -> None:
    message = r"full could not be written \(No space left on device\)"
    with pytest.raises(InputError, match=message), completed_file("/dev/full") as unfinished:
        unfinished.write_text("too much")
    tmp_path.chmod(0o500)
    try:
        if os.access(tmp_path, os.W_OK):
            pytest.skip("this user may write anywhere")
        message = r"could not be written \(Permission denied\)"
        with pytest.raises(InputError, match=message), completed_file(tmp_path / "out.txt") as unfinished:
            unfinished.write_text("anything")
    finally:
        tmp_path.chmod(0o700)
