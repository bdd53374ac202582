"""Settings of a Sonar 3D-15, read and changed over its HTTP interface; a server on the loopback takes its place, as
https://docs.waterlinked.com/sonar-3d/sonar-3d-15-api-swagger/swagger.json and wlsonar describe it."""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from threading import enumerate as enumerate_threads
from typing import Any

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.record import setup
from tests.samples.clutter_scans import refused, sonarmap
from tests.samples.live.sender import LOOPBACK, free_port, send
from tests.samples.recordings import recording

API = "/api/v1/integration"
ABOUT = {
    "chipid": "0x12345678", "hardware_revision": 6, "is_ready": True, "product_id": 21045,
    "product_name": "Sonar 3D-15", "variant": "", "version": "test", "version_short": "1.8.0",
}  # fmt: skip
AUTO = {"ntp_address": "auto"}
NTP = {"ntp_address": "10.0.0.1"}


class Stub:
    """The interface of a sonar: its settings by path, the clock's offset [s], and whether NTP servers answer."""

    def __init__(self, **about: Any) -> None:
        self.values: dict[str, Any] = {
            "/about": ABOUT | about,
            "/acoustics/enabled": True,
            "/acoustics/range": {"min": 0, "max": 15},
            "/acoustics/salinity": "salt",
            "/acoustics/speed_of_sound": 1478.0,
            "/output/imu-batch/enabled": True,
            "/time/ntp": AUTO,
        }
        self.offset, self.has_server, self.is_synced = 0.0, True, False
        self.posts: list[tuple[str, Any]] = []
        self.errors: dict[tuple[str, str], tuple[int, str]] = {}  # status and words, by method and path

    def status(self) -> dict[str, Any]:
        now = datetime.now(UTC) + timedelta(seconds=self.offset)
        by = self.values["/time/ntp"]["ntp_address"] if self.is_synced else ""
        since = 1 if self.is_synced else None
        stamp = now.isoformat().replace("+00:00", "Z")
        return {"system_time": stamp, "ntp_synced": self.is_synced, "ntp_synced_to": by,
                "ntp_seconds_since_last_sync": since}  # fmt: skip

    def answer(self, method: str, path: str, sent: Any) -> tuple[int, Any]:
        if (method, path) in self.errors:
            return self.errors[method, path]
        if method == "GET":
            values = self.values | {"/time/status": self.status()}
            return (200, values[path]) if path in values else (404, "404 page not found")
        self.posts.append((path, sent))
        if path == "/time/ntp/force-sync":
            self.is_synced, self.offset = self.has_server, 0.0 if self.has_server else self.offset
            return 200, {"success": self.is_synced, "message": "done", "status": self.status()}
        if path == "/time/manual":
            self.offset = (datetime.fromisoformat(sent["now"]) - datetime.now(UTC)).total_seconds()
        else:
            self.values[path] = sent
        return 204, None


@contextmanager
def serving(stub: Stub, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stub]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            length = int(self.headers.get("Content-Length", 0))
            sent = json.loads(self.rfile.read(length)) if length else None
            status, content = stub.answer(self.command, self.path.removeprefix(API), sent)
            body = b"" if content is None else (content if status >= 400 else json.dumps(content)).encode()
            self.send_response(status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        do_POST = do_GET

        def log_message(self, format: str, *args: Any) -> None: ...

    with ThreadingHTTPServer((LOOPBACK, 0), Handler) as server:
        monkeypatch.setattr(setup, "_PORT", server.server_port)
        monkeypatch.setenv("NO_PROXY", LOOPBACK)
        Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        try:
            yield stub
        finally:
            server.shutdown()


@pytest.fixture
def sonar(monkeypatch: pytest.MonkeyPatch) -> Iterator[Stub]:
    with serving(Stub(), monkeypatch) as stub:
        yield stub


def warnings(wanted: dict[str, Any] | None = None) -> list[str]:
    before = set(enumerate_threads())
    found = setup.check(wanted or {}, LOOPBACK)
    for thread in set(enumerate_threads()) - before:
        if thread.name == "settings":
            thread.join()
    return list(found)


def test_wanted_settings_are_set_and_each_change_is_shown(sonar: Stub) -> None:
    sonar.values |= {"/acoustics/speed_of_sound": 1491.0, "/output/imu-batch/enabled": False}
    sonar.offset = -7.5e6
    wanted = {"NTP server": "10.0.0.1", "water": "fresh", "speed of sound": 0.0, "range": (0.5, 12.0)}
    assert setup.configure(LOOPBACK, wanted) == [
        "NTP server: auto -> 10.0.0.1",
        "water: salt -> fresh",
        "speed of sound: 1491 m/s -> automatic",
        "range: 0 to 15 m -> 0.5 to 12 m",
        "IMU batches: off -> on",
        "clock: 87 days behind this computer's -> right",
    ]
    assert sonar.posts[:5] == [
        ("/time/ntp", NTP),
        ("/acoustics/salinity", "fresh"),
        ("/acoustics/speed_of_sound", 0.0),
        ("/acoustics/range", {"min": 0.5, "max": 12.0}),
        ("/output/imu-batch/enabled", True),
    ]
    assert [path for path, _ in sonar.posts[5:]] == ["/time/ntp/force-sync"]
    sonar.posts.clear()
    assert setup.configure(LOOPBACK, wanted) == []
    assert sonar.posts == []


def test_the_clock_is_set_from_this_computer_where_no_ntp_server_answers(sonar: Stub) -> None:
    sonar.offset, sonar.has_server = 3.5, False
    [change] = setup.configure(LOOPBACK, {})
    assert re.fullmatch(r"clock: 3\.\d\d s ahead of this computer's -> right", change)
    assert abs(sonar.offset) < 1.0


def test_a_clock_that_ntp_sets_otherwise_than_this_computers_is_left_and_named(sonar: Stub) -> None:
    sonar.offset, sonar.is_synced = -20.0, True
    sonar.errors["POST", "/time/ntp/force-sync"] = (409, "a force-sync is already ongoing")
    [warning] = warnings()
    assert re.match(r"the sonar's clock: (19|20)\.\d\d s behind this computer's, set by auto, wanted right", warning)
    with pytest.raises(InputError, match="already ongoing"):
        setup.configure(LOOPBACK, {})


def test_nothing_is_changed_if_a_setting_cannot_be_read(sonar: Stub) -> None:
    sonar.errors["GET", "/acoustics/range"] = (500, "internal error")
    with pytest.raises(InputError, match="answers 500: internal error"):
        setup.configure(LOOPBACK, {"water": "fresh", "range": (1.0, 5.0)})
    assert sonar.posts == []


@pytest.mark.parametrize(
    ("path", "wanted", "code"),
    [
        ("/acoustics/range", {"range": (0.0, 99.0)}, 400),
        ("/acoustics/speed_of_sound", {"speed of sound": 1999.0}, 408),
        ("/time/ntp", {"NTP server": "?"}, 400),
        ("/acoustics/salinity", {"water": "fresh"}, 503),
    ],
)
def test_a_refusal_is_shown_in_the_words_of_the_sonar(
    sonar: Stub, path: str, wanted: dict[str, Any], code: int
) -> None:
    sonar.errors["POST", path] = (code, "max must be\n at most 20")
    with pytest.raises(InputError, match=f"sonar at {LOOPBACK}: .* answers {code}: max must be at most 20"):
        setup.configure(LOOPBACK, wanted)


def test_right_settings_raise_no_warning_and_nothing_is_changed(sonar: Stub) -> None:
    assert warnings() == []
    assert sonar.posts == []


def test_wrong_settings_are_named_and_not_changed(sonar: Stub) -> None:
    sonar.values |= {"/acoustics/enabled": False, "/acoustics/speed_of_sound": 1491.0}
    sonar.values["/output/imu-batch/enabled"], sonar.offset = False, -1e9
    off, speed, limits, imu, clock = warnings({"range": (0.5, 10.0)})
    assert off.startswith("the sonar's acoustics are off")
    assert speed.startswith(
        "the sonar computes ranges with 1,491 m/s; a new one has 1,491. Fresh water of 10 degrees has 1,447"
    )
    assert limits == "the sonar's range: 0 to 15 m, wanted 0.5 to 10 m; --configure sets it"
    assert imu == "the sonar's IMU batches: off, wanted on; --configure sets it"
    assert clock == "the sonar's clock: 11,574 days behind this computer's, wanted right; --configure sets it"
    assert sonar.posts == []


@pytest.mark.parametrize(
    ("speed", "is_wrong"), [(0, False), (1447, False), (1500.5, False), (1491, True), (1200, True)]
)
def test_speeds_of_sound_that_water_does_not_have_are_named(sonar: Stub, speed: float, is_wrong: bool) -> None:
    sonar.values["/acoustics/speed_of_sound"] = speed
    assert len(warnings()) == is_wrong
    assert warnings({"speed of sound": speed}) == []


@pytest.mark.parametrize(
    ("version", "words"),
    [
        ("1.4.0", "requires Sonar 3D-15 release 1.5.1 or newer. Detected version: 1.4.0"),
        ("2.0.0-rc1", "its firmware answers unexpectedly"),
        ("", "its firmware answers unexpectedly"),
    ],
)
def test_unknown_firmware_is_named(monkeypatch: pytest.MonkeyPatch, version: str, words: str) -> None:
    with serving(Stub(version_short=version), monkeypatch):
        [warning] = warnings()
        assert warning.startswith("the sonar's settings are not checked: ")
        assert words in warning
        with pytest.raises(InputError, match=re.escape(words)):
            setup.configure(LOOPBACK, {})


def test_old_firmware_is_set_up_as_far_as_it_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    with serving(Stub(version_short="1.6.1"), monkeypatch) as stub:
        for path in ("/acoustics/salinity", "/output/imu-batch/enabled", "/time/ntp"):
            del stub.values[path]
        assert warnings() == []
        assert setup.configure(LOOPBACK, {"range": (0.0, 8.0)}) == ["range: 0 to 15 m -> 0 to 8 m"]
        with pytest.raises(InputError, match=r"release 1\.7\.1 or newer\. Detected version: 1\.6\.1"):
            setup.configure(LOOPBACK, {"NTP server": "auto"})


@pytest.mark.parametrize("content", ["no JSON", {}, {"system_time": 3}, None, [1]])
def test_answers_in_another_form_stop_no_recording(sonar: Stub, content: Any) -> None:
    for path in ("/acoustics/range", "/output/imu-batch/enabled"):
        sonar.values[path] = content
    [warning] = warnings({"range": (1.0, 2.0)})
    assert warning.startswith("the sonar's settings are not checked: its firmware answers unexpectedly (")


def test_a_sonar_without_interface_is_recorded_and_a_sentence_says_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(setup, "_PORT", 9)
    words = "the sonar's settings are not checked: its HTTP interface does not answer"
    assert warnings() == [words]
    to = ("--unicast", f"{LOOPBACK}:{free_port()}", "--sonar", LOOPBACK, "--duration", "2")
    ended = sonarmap("record", "-o", tmp_path / "a.sonar", *to)
    assert ended.exit_code == 3
    assert ended.stderr.count(words) == 1
    refused(sonarmap("record", "-o", tmp_path / "a.sonar", *to, "--configure"), "cannot set up the sonar", "--sonar")


def test_record_sets_up_the_sonar_only_with_the_flag(sonar: Stub, tmp_path: Path) -> None:
    to = ("--unicast", f"{LOOPBACK}:{free_port()}", "--sonar", LOOPBACK, "--duration", "1", "-o", tmp_path / "a.sonar")
    options = ("--range", "0.5", "12", "--water", "fresh", "--ntp", "10.0.0.1")
    ended = sonarmap("record", *to, *options)
    assert "range: 0 to 15 m, wanted 0.5 to 12 m; --configure sets it" in ended.stderr
    assert sonar.posts == []
    ended = sonarmap("record", *to, *options, "--configure", "--json")
    assert json.loads(ended.stdout)["changed"] == [
        "NTP server: auto -> 10.0.0.1",
        "water: salt -> fresh",
        "speed of sound: 1478 m/s -> automatic",
        "range: 0 to 15 m -> 0.5 to 12 m",
    ]
    ended = sonarmap("record", *to, "--sound-speed", "1447", "--configure")
    assert "changed in the sonar, for good: speed of sound: automatic -> 1447 m/s" in ended.stderr
    assert "not checked" not in ended.stderr


def test_nothing_is_changed_if_the_recording_cannot_be_written(sonar: Stub, tmp_path: Path) -> None:
    taken = tmp_path / "a.sonar"
    taken.touch()
    refused(sonarmap("record", "-o", taken, "--sonar", LOOPBACK, "--configure", "--water", "fresh"), "is there already")
    assert sonar.posts == []


def test_the_address_of_the_packets_is_that_of_the_settings(sonar: Stub, tmp_path: Path) -> None:
    sonar.values["/acoustics/enabled"] = False
    packets, to = [packet.content for packet in recording(4)], (LOOPBACK, free_port())
    Thread(target=send, args=(packets * 10, to, 20.0), daemon=True).start()
    ended = sonarmap("record", "-o", tmp_path / "a.sonar", "--unicast", f"{to[0]}:{to[1]}", "--duration", "3")
    assert ended.exit_code == 0
    assert ended.stderr.count("the sonar's acoustics are off") == 1
    assert (tmp_path / "a.sonar").stat().st_size > 0


@pytest.mark.parametrize(
    "options",
    ["--range 5 1", "--range -1 5", "--range nan 5", "--water river", "--sound-speed 343", "--sound-speed nan"],
)
def test_impossible_settings_are_refused(options: str, tmp_path: Path) -> None:
    ended = sonarmap("record", "-o", tmp_path / "a.sonar", *options.split())
    assert ended.exit_code == 2
    assert options.split()[0] in ended.stderr
