"""Vehicles and stations of a link, as the doctor tells of them: put together of what was counted and judged."""

from __future__ import annotations

from collections.abc import Iterable

from gcs_bridge.events import utc
from gcs_bridge.inspection.heard import Heard
from gcs_bridge.inspection.schema import Ask, Clock, Loss, Message, Missing, Signing, SigningState, Station, Vehicle
from gcs_bridge.mavlink.requests import request_command
from gcs_bridge.report import schema
from gcs_bridge.report.rows import in_percent, in_seconds
from gcs_bridge.telemetry.census import ComponentSeen, MessageSeen, UtcSaid
from gcs_bridge.telemetry.samples import IMU_MESSAGES, STREAMS

__all__ = ["stations", "vehicles"]
# From so much loss on it is asked whether it is one: where messages are left out on the way, those that come evenly
# miss far less than the sequence numbers do.
_DOUBTED_SHARE, _DOUBTED_FRAMES, _EVEN = 0.02, 20, 0.25
_DAY_S = 86_400
_MOST_STATIONS = 100  # that are listed; all are counted
_RADIO = 68  # MAV_COMP_ID_TELEMETRY_RADIO: it sends no heartbeat that would say so
_LEAST_EVEN = 50  # messages, to tell how evenly they come


def vehicles(heard: Heard) -> list[Vehicle]:
    """The link's vehicles, in their order."""
    seen = {one.address: one for one in heard.counted.census.components()}
    return [
        _vehicle(heard, judged, seen[judged.sysid, judged.compid])
        for judged in heard.entry.vehicles
        if (judged.sysid, judged.compid) in seen
    ]


def stations(heard: Heard) -> list[Station]:
    """Who else was heard on the link: the hundred that sent most, by system and component."""
    flying = {(one.sysid, one.compid) for one in heard.entry.vehicles}
    said = {(one.sysid, one.compid): one for one in heard.entry.others}
    asks = heard.counted.census.asks()
    others = [seen for seen in heard.counted.census.components() if seen.address not in flying]
    others = sorted(sorted(others, key=lambda seen: -seen.frames)[:_MOST_STATIONS], key=lambda seen: seen.address)
    return [
        Station(
            link=heard.name,
            sysid=seen.sysid,
            compid=seen.compid,
            autopilot=said[seen.address].autopilot if seen.address in said else "unknown",
            type=_type(seen, said[seen.address].type if seen.address in said else "unknown"),
            frames=seen.frames,
            messages=_messages(heard, seen.messages),
            asks=tuple(
                Ask(of=ask.of, what=ask.what, how=ask.how, rate_hz=ask.rate_hz, times=times)
                for ask, times in asks
                if ask.by == seen.address
            ),
        )
        for seen in others
    ]


def _type(seen: ComponentSeen, said: str) -> str:
    """What a station is, by what it says of itself; of a radio, that says nothing, by its number."""
    return "telemetry_radio" if said == "unknown" and seen.compid == _RADIO else said


def _vehicle(heard: Heard, judged: schema.Vehicle, seen: ComponentSeen) -> Vehicle:
    addresses = heard.addresses.get(seen.sysid, ())
    messages = _messages(heard, seen.messages)
    port = addresses[0][1] if len(addresses) == 1 else None
    return Vehicle(
        link=heard.name,
        sysid=seen.sysid,
        compid=seen.compid,
        autopilot=judged.autopilot,
        firmware=seen.firmware,
        type=judged.type,
        address=", ".join(f"[{host}]:{port}" if ":" in host else f"{host}:{port}" for host, port in addresses) or None,
        mavlink=tuple(version for version, frames in ((1, seen.mavlink1), (2, seen.frames - seen.mavlink1)) if frames),
        frames=seen.frames,
        messages=messages,
        loss=_loss(judged, seen),
        signing=_signing(seen),
        clock=_clock(judged.boots, seen.utc),
        missing=tuple(
            Missing(message=name, command=command, where=where)
            for name in _lacking(messages)
            for where, command in [request_command(name, judged.autopilot, px4_udp_port=port)]
        ),
    )


def _messages(heard: Heard, seen: dict[str, MessageSeen]) -> dict[str, Message]:
    now_us = heard.counted.latest_rx_us
    return {
        name: Message(
            count=one.frames,
            copies=one.copies,
            rate_hz=one.rate_hz,
            jitter_ms=one.jitter_ms,
            age_s=max(now_us - one.last_rx_us, 0) / 1e6 if one.last_rx_us > 0 else None,
        )
        for name, one in seen.items()
    }


def _lacking(messages: Iterable[str]) -> list[str]:
    """Those of the three messages that are compared that do not come; any of an IMU will do."""
    there = set(messages)
    lacking = [name for name in STREAMS if name not in there]
    return lacking if there & set(IMU_MESSAGES) else [*lacking, "RAW_IMU"]


def _loss(judged: schema.Vehicle, seen: ComponentSeen) -> Loss:
    received, lost = seen.frames - seen.copies, seen.lost
    share = lost / (received + lost) if received else 0.0
    if seen.numbering.stands:
        why = "its frames are not numbered"
    elif seen.numbering.is_of_several:
        why = "its frames are numbered apart: they come over several links, or from several senders, merged into one"
    elif lost >= _DOUBTED_FRAMES and share >= _DOUBTED_SHARE and (even := _even(judged, share)):
        why = (
            f"behind a router: the sequence numbers miss {in_percent(share)} of the frames, but {even} comes evenly; "
            "something on the way leaves messages out"
        )
        return Loss(lost=None, share=None, text=f"not measurable {why}")
    else:
        text = f"{lost} of {received + lost} frames ({in_percent(share)}) lost or damaged"
        return Loss(lost=lost, share=share, text=text)
    return Loss(lost=None, share=None, text=f"not measurable: {why}")


def _even(judged: schema.Vehicle, share: float) -> str | None:
    """A message that misses far less than that share of its own, by its times; None: there is none."""
    for name in STREAMS:
        stream = judged.streams.get(name)
        if stream is None or stream.lost is None or stream.count < _LEAST_EVEN:
            continue
        if stream.lost < _EVEN * share * (stream.count + stream.lost):
            return name
    return None


def _signing(seen: ComponentSeen) -> Signing:
    worth = "not verified" if seen.held is None else f"{seen.held} of {seen.signed} signatures verified"
    said: dict[SigningState, str] = {
        "unsigned": "unsigned",
        "signed": f"signed, {worth}",
        "mixed": f"mixed: {seen.signed} of {seen.frames} frames are signed, {worth}",
    }
    state: SigningState = "unsigned" if not seen.signed else "signed" if seen.signed == seen.frames else "mixed"
    return Signing(
        state=state,
        signed=seen.signed,
        unsigned=seen.frames - seen.signed,
        verified=seen.held,
        wrong=seen.wrong,
        text=said[state],
    )


def _clock(boots: tuple[schema.Boot, ...], said: UtcSaid | None) -> Clock:
    last_s = boots[-1].last_boot_s if boots else None
    words = ["no time since its start was told" if last_s is None else f"{in_seconds(last_s)} since its start"]
    if len(boots) > 1:
        words.append(f"{len(boots)} boots were seen")
    date = None if said is None else utc(said.unix_us)
    behind_s = None
    if said is None or date is None:
        words.append("it does not tell UTC")
    else:
        behind_s = (said.t_rx_us - said.unix_us) / 1e6 if said.t_rx_us > 0 else None
        words.append(f"UTC {date}" + ("" if behind_s is None else f", {_behind(behind_s)}"))
    return Clock(boots=len(boots), boot_s=last_s, utc=date, utc_behind_s=behind_s, text="; ".join(words))


def _behind(seconds: float) -> str:
    much = in_seconds(abs(seconds)) if abs(seconds) < _DAY_S else f"{abs(seconds) / _DAY_S:.1f} days"
    return f"{much} {'behind' if seconds >= 0 else 'before'} the receiver's clock"
