"""What there is to know of a link, and to do about it: each rule a function, each advice with a code that stays.

docs/field.md lists the codes. A rule only puts into words what was counted and judged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from gcs_bridge.checks.stream import TWO_SENDERS
from gcs_bridge.errors import one_line
from gcs_bridge.events import Damage, LinkDown, RateRequested
from gcs_bridge.inspection.heard import SERIAL, STREAM, Heard, Refused
from gcs_bridge.inspection.schema import Advice, Level, Station, Vehicle
from gcs_bridge.judging.link import copies
from gcs_bridge.mavlink.requests import lasting_request
from gcs_bridge.report.rows import counted, in_percent, in_seconds
from gcs_bridge.telemetry.samples import STREAMS

__all__ = ["LEVELS", "advice", "refusal"]
LEVELS: tuple[Level, ...] = ("unusable", "wrong", "missing", "advice", "note")
"""What matters most first."""
_RATE_HZ = 25
_OF_RADIOS = frozenset({"RADIO_STATUS", "RADIO"})
_BESIDE_HEARTBEATS = frozenset({"HEARTBEAT", "TIMESYNC", "PING", "OPEN_DRONE_ID_ARM_STATUS"})
_LOSSY, _DAMAGED, _UNKNOWN = 0.05, 0.01, 0.01  # shares from which on it is worth a word
_STALE_S, _STALE_PERIODS = 2.0, 5


def refusal(refused: Refused) -> Advice:
    """Why a link or file cannot be used."""
    code = getattr(refused.error, "code", "no_recording")
    command = getattr(refused.error, "command", None)
    return _of(refused, code, "unusable", str(refused.error).removeprefix(f"{refused.name}: "), command)


def advice(heard: Heard, vehicles: Sequence[Vehicle], stations: Sequence[Station]) -> list[Advice]:
    """All that is to be said of a link."""
    return [one for rule in _RULES for one in rule(heard, vehicles, stations)]


def _of(
    heard: Heard | Refused,
    code: str,
    level: Level,
    text: str,
    command: str | None = None,
    vehicle: Vehicle | None = None,
) -> Advice:
    address = None if vehicle is None else (vehicle.sysid, vehicle.compid)
    return Advice(code=code, level=level, text=one_line(text), command=command, link=heard.name, vehicle=address)


# --- nothing, or nothing to be read ----------------------------------------------------------------------------------

_SILENT = {
    "udpin": "let the vehicle, or a router, send to this port; a firewall may keep it back",
    "tcp": "the other side took the connection, and says nothing: some wait until a ground station speaks",
    "tcpin": "nobody connected here, or who did says nothing",
    "mcast": "nobody sends to this group, or another network interface does",
    SERIAL: "is the vehicle powered, is it this device, and are RX and TX crossed?",
}


def _no_bytes(heard: Heard, _: Sequence[Vehicle], __: Sequence[Station]) -> Iterator[Advice]:
    if not heard.entry.bytes:
        port = heard.name.rpartition(":")[2]
        command = f"sudo tcpdump -ni any udp port {port}" if heard.kind in ("udpin", "mcast") else None
        text = f"no byte came in {in_seconds(heard.seconds)}: {_SILENT[heard.kind]}"
        yield _of(heard, "no_bytes", "unusable", text, command)


def _no_frames(heard: Heard, _: Sequence[Vehicle], __: Sequence[Station]) -> Iterator[Advice]:
    if heard.entry.bytes and not heard.entry.salvage.frames:
        if heard.kind == SERIAL:
            other = 57600 if heard.baud != 57600 else 115200
            command = f"gcs-bridge doctor {heard.name} --baud {other}"
            yield _of(heard, "wrong_baud", "unusable", heard.unreadable, command)
        else:
            yield _of(heard, "no_frames", "unusable", heard.unreadable)


def _gone(heard: Heard, _: Sequence[Vehicle], __: Sequence[Station]) -> Iterator[Advice]:
    ends = [event for event in heard.events if isinstance(event, LinkDown)]
    if ends:
        yield _of(heard, "link_down", "advice", f"the link went {counted(len(ends), 'time')}: {ends[-1].reason}")
    dropped = sum(event.dropped for event in heard.events if isinstance(event, Damage))
    if dropped:
        yield _of(heard, "dropped", "advice", f"{dropped} datagrams were dropped here: this machine is too slow")


def _damage(heard: Heard, _: Sequence[Vehicle], __: Sequence[Station]) -> Iterator[Advice]:
    salvage, line_ends = heard.entry.salvage, heard.counted.line_ends
    if line_ends is not None:
        yield _of(
            heard,
            "text_conversion",
            "wrong",
            f"a text conversion has turned {line_ends} in what came, as if it were text: what that broke is lost; "
            "copy it anew as binary, or make the way binary (a serial line: raw, no icrnl or onlcr)",
        )
    elif heard.entry.bytes and salvage.frames and salvage.skipped_bytes > _DAMAGED * heard.entry.bytes:
        yield _of(
            heard,
            "damaged",
            "advice",
            f"in {salvage.skipped_bytes} of {heard.entry.bytes} bytes no frame could be read, and "
            f"{counted(salvage.bad_crc, 'frame')} had a wrong checksum: noise on the way, a speed that is a little "
            "off, or two programs that read one device",
        )
    if salvage.unverified > _UNKNOWN * salvage.frames and salvage.frames:
        text = f"{salvage.unverified} frames are of messages that are not known here: another --dialect, or a newer "
        text += "pymavlink, may know them"
        yield _of(heard, "unknown_messages", "advice", text)


# --- who is there ----------------------------------------------------------------------------------------------------


def _nobody_flies(heard: Heard, vehicles: Sequence[Vehicle], stations: Sequence[Station]) -> Iterator[Advice]:
    if vehicles or not heard.entry.salvage.frames:
        return
    radios = [one for one in stations if one.type == "telemetry_radio" or one.messages.keys() <= _OF_RADIOS]
    ground = [one for one in stations if one.type == "gcs"]
    named = ", ".join(f"{one.sysid},{one.compid}" for one in stations[:8])
    if stations and len(radios) == len(stations):
        text = (
            f"only the telemetry radio of this side is heard ({named}), no vehicle: is the other radio powered, has it "
            "the same net id and air speed, and is it wired to a port that speaks MAVLink?"
        )
        yield _of(heard, "radio_only", "missing", text)
    elif ground and len(ground) + len(radios) == len(stations):
        text = (
            f"only ground stations are heard ({named}), no vehicle: this is the side of the stations, or the vehicle "
            "is off; let it, or the router, send here too"
        )
        yield _of(heard, "gcs_only", "missing", text)
    else:
        yield _of(heard, "no_vehicle", "missing", f"no vehicle is heard; who is: {named or 'nobody'}")


def _two_senders(heard: Heard, vehicles: Sequence[Vehicle], _: Sequence[Station]) -> Iterator[Advice]:
    entries = {(one.sysid, one.compid): one for one in vehicles}
    for judged in heard.entry.vehicles:
        alarm = next((one for one in judged.alarms if one.what.startswith(TWO_SENDERS)), None)
        if alarm is not None:
            text = (
                f"{alarm.what}; give one of them another system id (ArduPilot: MAV_SYSID, or SYSID_THISMAV before 4.7; "
            )
            text += "PX4: MAV_SYS_ID), or take one away"
            yield _of(heard, "two_senders", "wrong", text, vehicle=entries.get((judged.sysid, judged.compid)))


def _twice(heard: Heard, vehicles: Sequence[Vehicle], _: Sequence[Station]) -> Iterator[Advice]:
    for vehicle in vehicles:
        repeated = sum(one.copies for one in vehicle.messages.values())
        told = copies(vehicle.frames - repeated, repeated)
        if told is not None:
            text = f"{told}: it counts once; two ways lead here, a router sends it twice, or a loop goes round"
            yield _of(heard, "every_frame_twice", "advice", text, vehicle=vehicle)


# --- what comes ------------------------------------------------------------------------------------------------------


def _missing(heard: Heard, vehicles: Sequence[Vehicle], _: Sequence[Station]) -> Iterator[Advice]:
    for vehicle in vehicles:
        if not vehicle.missing:
            continue
        names = [one.message for one in vehicle.missing]
        level: Level = "missing" if set(names) & set(STREAMS) else "advice"
        first = vehicle.missing[0]
        command = f"gcs-bridge listen {heard.typed} --request-rates {_RATE_HZ}" if heard.is_live else first.command
        to_type = f"type '{first.command}' in {first.where}"
        if heard.is_live:
            to_type = "the command asks the vehicle, and so TRANSMITS"
        lasting = lasting_request(names, vehicle.autopilot)
        mend = f"; {to_type}" + ("" if lasting is None else f"; for good: {lasting}")
        if vehicle.messages.keys() <= _BESIDE_HEARTBEATS:
            text = "nothing comes but heartbeats: autopilots send little more before a ground station asks for it"
            yield _of(heard, "heartbeats_only", level, text + mend, command, vehicle)
        else:
            text = f"{' and '.join(names)} {'does' if len(names) == 1 else 'do'} not come"
            yield _of(heard, "missing_message", level, text + mend, command, vehicle)


def _imu(heard: Heard, vehicles: Sequence[Vehicle], _: Sequence[Station]) -> Iterator[Advice]:
    for vehicle in vehicles:
        instead = [name for name in ("HIGHRES_IMU", "SCALED_IMU") if name in vehicle.messages]
        if vehicle.autopilot == "px4" and "RAW_IMU" not in vehicle.messages and instead:
            text = f"PX4 sends no RAW_IMU: {instead[0]}, which comes, is compared in its place"
            yield _of(heard, "imu_instead", "note", text, vehicle=vehicle)


def _stale(heard: Heard, vehicles: Sequence[Vehicle], _: Sequence[Station]) -> Iterator[Advice]:
    for vehicle in vehicles if heard.is_live else ():
        for name in STREAMS:
            one = vehicle.messages.get(name)
            if one is None or one.age_s is None or one.rate_hz is None:
                continue
            if one.age_s > max(_STALE_S, _STALE_PERIODS / one.rate_hz):
                text = f"{name} came, and has not come for {in_seconds(one.age_s)}"
                yield _of(heard, "stale_message", "advice", text, vehicle=vehicle)


def _lossy(heard: Heard, vehicles: Sequence[Vehicle], _: Sequence[Station]) -> Iterator[Advice]:
    for vehicle in vehicles:
        if vehicle.loss.share is not None and vehicle.loss.share >= _LOSSY:
            text = f"{in_percent(vehicle.loss.share)} of its frames are lost or damaged on the way: a weak radio, or "
            text += "more than the link can carry; lower rates help"
            yield _of(heard, "lossy", "advice", text, vehicle=vehicle)


def _rates(heard: Heard, _: Sequence[Vehicle], __: Sequence[Station]) -> Iterator[Advice]:
    undone = [event for event in heard.events if isinstance(event, RateRequested) and event.undo_each_other]
    if undone:
        text = f"two stations undo each other's rates: {undone[-1].reason}; let one of them ask for none (MAVProxy: "
        text += "'set streamrate -1'; Mission Planner: telemetry rates -1)"
        yield _of(heard, "rates_undone", "advice", text, "set streamrate -1")


def _signing(heard: Heard, vehicles: Sequence[Vehicle], stations: Sequence[Station]) -> Iterator[Advice]:
    for vehicle in vehicles:
        if vehicle.signing.state == "mixed":
            text = (
                f"signing is {vehicle.signing.text}: it was set up meanwhile, or somebody else sends under its number"
            )
            yield _of(heard, "mixed_signing", "advice", text, vehicle=vehicle)
        elif vehicle.signing.state == "signed" and vehicle.signing.verified is None:
            text = "its frames are signed; without the key nobody knows whether rightly (--signing-key-file FILE)"
            yield _of(heard, "signed", "note", text, vehicle=vehicle)
        signed, verified, wrong = vehicle.signing.signed, vehicle.signing.verified, vehicle.signing.wrong
        if wrong:
            text = f"{wrong} of {signed} signatures are by another key, or their frames were changed"
            yield _of(heard, "wrong_signatures", "wrong", text, vehicle=vehicle)
        if verified is not None and wrong is not None and verified + wrong < signed:
            text = f"{signed - verified - wrong} of {signed} signatures are right and their times had passed: frames "
            text += "that came again, or the sender's clock was set back"
            yield _of(heard, "old_signatures", "advice", text, vehicle=vehicle)
    everybody: list[Vehicle | Station] = [*vehicles, *stations]
    if any("SETUP_SIGNING" in one.messages for one in everybody):
        text = (
            "a signing key came in the clear (SETUP_SIGNING): whoever has these bytes can sign; do not pass them on, "
        )
        text += "and choose another key"
        yield _of(heard, "key_in_the_clear", "advice", text)


def _no_times(heard: Heard, _: Sequence[Vehicle], __: Sequence[Station]) -> Iterator[Advice]:
    if heard.kind == STREAM:
        text = "a raw stream without receive times: how often, how evenly and how long ago messages came is not known"
        yield _of(heard, "no_times", "note", text)


_Rule = Callable[[Heard, Sequence[Vehicle], Sequence[Station]], Iterator[Advice]]
_RULES: tuple[_Rule, ...] = (
    *(_no_bytes, _no_frames, _damage, _two_senders, _nobody_flies, _missing),
    *(_gone, _twice, _lossy, _stale, _rates, _signing, _imu, _no_times),
)
