"""The page at every size: what it says of a vehicle, of many, of alarms; never more than fits."""

import itertools

import pytest
from msgspec.structs import replace

from gcs_bridge.alarms.state import Announcement, State
from gcs_bridge.judging.snapshot import CheckNow, Snapshot
from gcs_bridge.screen.alerts import id_of
from gcs_bridge.screen.history import History
from gcs_bridge.screen.memory import Memory
from tests.helpers.seen_now import alarm, alarmed, attitude, drawn, scene, vehicle

FLEET = [vehicle(sysid, (sysid, 0, 10 * sysid)) for sysid in range(1, 17)]


def row_with(text: str, words: str) -> str:
    return next(line for line in text.splitlines() if words in line)


def test_both_forms_as_numbers() -> None:
    """Roll, pitch and yaw of both messages, the quaternion of 30° about down, and the rates, with their signs."""
    text = drawn(scene([vehicle(rpy_deg=(0.0, 0.0, 30.0))])).text()
    assert row_with(text, "Euler  ").split()[-5:] == ["+0.00", "+0.00", "+30.00", "0.1", "s"]
    numbers = [line.split() for line in text.splitlines() if "quaternion " in line]
    assert any(row[-4:] == ["+0.9659", "+0.0000", "+0.0000", "+0.2588"] for row in numbers)  # cos 15°, sin 15°
    assert any(row[-3:] == ["+1.00", "-2.00", "+3.00"] for row in numbers)


def test_disagreement_stands_beside_its_limit() -> None:
    """25° of 0.5° is above, 0.1° within: in words."""
    above = drawn(scene([alarmed()])).text()
    assert "apart 25.000° of limit 0.500° ABOVE" in above
    within = vehicle(checks=(CheckNow(name="euler_quaternion", verdict="agree", alarms=(alarm(0.1),)),))
    assert "apart 0.100° of limit 0.500° within" in drawn(scene([within])).text()


def test_severities_have_the_words_of_flight_decks() -> None:
    """An alarm is a WARNING, a warning a CAUTION, what is not compared an ADVISORY: in this order, each with a sign."""
    unknown = replace(vehicle(3), verdict="no_compare")
    text = drawn(scene([unknown, alarmed(2, severity="warning"), alarmed(1)])).text()
    rows = [row_with(text, words) for words in ("▲ WARNING  1,1", "■ CAUTION  2,1", "● ADVISORY 3,1")]
    lines = text.splitlines()
    assert [lines.index(row) for row in rows] == sorted(lines.index(row) for row in rows)
    assert "NO COMPARE" in rows[2]
    assert "▲ 1 WARNING" in lines[0]
    assert "■ 1 CAUTION" in lines[0]


@pytest.mark.parametrize(
    ("state", "announcement", "words"),
    [
        (State.RAISED, Announcement.TOLD, "NOT ACK'D"),
        (State.ACKNOWLEDGED, Announcement.TOLD, "acknowledged"),
        (State.RETURNED, Announcement.TOLD, "gone, not ack'd"),
        (State.CLEARING, Announcement.TOLD, "going, not ack'd"),
        (State.RAISED, Announcement.SHELVED, "shelved"),
    ],
)
def test_the_state_of_an_alarm_is_a_word(state: State, announcement: Announcement, words: str) -> None:
    """Never a colour alone."""
    text = drawn(scene([alarmed(state=state, announcement=announcement)])).text()
    assert words in row_with(text, "WARNING  1,1")


@pytest.mark.parametrize(
    ("state", "announcement"),
    [
        (State.NORMAL, Announcement.TOLD),
        (State.PENDING, Announcement.TOLD),
        (State.RAISED, Announcement.SUPPRESSED),
        (State.RAISED, Announcement.SHELVED_SUPPRESSED),
    ],
)
def test_what_is_no_alarm_is_not_listed(state: State, announcement: Announcement) -> None:
    """Pending ones, and those that another one says already."""
    assert "no alarm, of no vehicle" in drawn(scene([alarmed(state=state, announcement=announcement)])).text()


def test_what_is_shelved_is_last_and_calls_for_no_attention() -> None:
    """It is listed below a caution, and not counted."""
    text = drawn(scene([alarmed(1, announcement=Announcement.SHELVED), alarmed(2, severity="warning")])).text()
    lines = text.splitlines()
    assert "1,1 shlv" in text  # and is not called fine
    assert lines.index(row_with(text, "CAUTION  2,1")) < lines.index(row_with(text, "WARNING  1,1"))
    assert "WARNING" not in lines[0]


def test_sixteen_vehicles_at_80_by_24() -> None:
    """Each has its chip, one has its numbers; of one that is lost that is said."""
    memory = Memory()
    memory.lost.add(id_of(FLEET[6]))
    text = drawn(scene([alarmed(1), *FLEET[1:]], chosen=4, memory=memory)).text()
    chips = "".join(text.splitlines()[1:3])
    for sysid in range(1, 17):
        word = {1: "WARN", 7: "LOST"}.get(sysid, "ok")
        assert f"{sysid},1 {word}" in chips
    assert "›5,1 ok" in chips
    assert row_with(text, "Euler  ").split()[-5] == "+5.00"
    assert "LOST: nothing comes from it" in text


def test_sixteen_vehicles_at_200_by_60() -> None:
    """A table: each one's attitude in a row, beside the chosen one's page."""
    text = drawn(scene(FLEET, chosen=2), 200, 60).text()
    for sysid in range(1, 17):
        assert f"R{sysid:+.1f} P+0.0 Y{10 * sysid:+.1f}" in text
    assert "euler_quaternion" in text


def test_a_hundred_vehicles_leave_room() -> None:
    """Of more than there is room for, those around the chosen one are shown."""
    many = [vehicle(sysid) for sysid in range(1, 101)]
    text = drawn(scene(many, chosen=98)).text()
    assert "›99,1 ok" in text
    assert "apart" in text


def test_silence_never_looks_like_health() -> None:
    """Of streams that are silent the horizon is taken away, and the numbers say so."""
    silent = [attitude((0, 0, 0), euler=euler, alive=False) for euler in (True, False)]
    text = drawn(scene([replace(vehicle(), attitude=silent[0], attitude_quaternion=silent[1])])).text()
    assert "ATTITUDE SILENT" in text
    assert "░" not in text
    assert text.count("SILENT") == 3
    assert "ATTITUDE_QUATERNION silent" in text
    never = replace(vehicle(), attitude=None, attitude_quaternion=None, verdict="no_compare", checks=())
    assert "NO ATTITUDE" in drawn(scene([never])).text()
    assert "apart: not compared yet" in drawn(scene([never])).text()


def test_a_link_that_is_down_is_told_at_the_top() -> None:
    """Whatever its vehicles showed last."""
    of = scene([vehicle()])
    down = replace(of.snapshot, links=tuple(replace(link, is_open=False) for link in of.snapshot.links))
    assert "1 LINK DOWN" in drawn(scene([vehicle()], snapshot=down)).text().splitlines()[0]
    assert "DOWN" not in drawn(of).text()


def test_what_was_told_before_stands_on_the_page_of_help() -> None:
    """The whole of it, as the address at which the viewer is, which no row of events has room for."""
    memory = Memory()
    address = "http://127.0.0.1:9090/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A9876%2Fproxy&hide_welcome_screen"
    memory.tell(f"gcs-bridge: note: viewer: open {address}", is_note=True)
    shown = drawn(scene([vehicle()], memory=memory, shows_help=True), 80, 30).text()
    assert address in "".join(line.strip() for line in shown.splitlines())


def test_what_is_no_number_is_no_zero() -> None:
    """NaN on the wire is a question mark."""
    nan = float("nan")
    bad = attitude((0, 0, 0), euler=False, valid=False, q_nb=(nan, 0.0, 0.0, 0.0))
    text = drawn(scene([replace(vehicle(), attitude_quaternion=bad)])).text()
    assert "BAD" in text
    assert "?" in text
    assert "ATTITUDE_QUATERNION holds no attitude" in text


def test_before_anything_came() -> None:
    """What is waited for is said, with what came instead."""
    empty = scene([])
    assert "no vehicle yet: 1 frames, none of them a vehicle's" in drawn(empty).text()
    assert (
        "waiting: nothing was received" in drawn(scene([], snapshot=Snapshot(links=(), vehicles=()), alerts=[])).text()
    )


def test_no_size_is_too_small_or_too_large() -> None:
    """With one vehicle, many, none, alarms, help: every row as wide as the terminal."""
    histories = {id_of(FLEET[0]): History()}
    scenes = [scene([]), scene(FLEET[:1]), scene([alarmed(1), *FLEET[1:]], histories=histories)]
    scenes += [scene([alarmed(sysid) for sysid in range(1, 40)], chosen=30), scene(FLEET, shows_help=True)]
    sizes = itertools.product((1, 2, 20, 39, 44, 61, 80, 120, 200), (1, 2, 5, 11, 12, 16, 24, 60))
    for (width, height), one in itertools.product(sizes, scenes):
        canvas = drawn(one, width, height)
        assert len(canvas.signs) == len(canvas.roles) == height
        assert {len(row) for row in canvas.signs} == {len(row) for row in canvas.roles} == {width}


def test_the_smallest_page_says_the_most_important() -> None:
    """At 20×5 there is still the worst alarm, and the attitude."""
    text = drawn(scene([alarmed()]), 20, 5).text()
    assert "WARN" in text
    assert "R+0.0 P+0.0 Y+0.0" in text
