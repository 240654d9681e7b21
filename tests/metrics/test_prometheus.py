"""A real Prometheus: it reads the bridge, its tool takes the rules, and every query that is shipped is answered."""

import json
import re
import shutil
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge.metrics.families import FAMILIES
from gcs_bridge.resources import config_folder
from tests.helpers.live_links import Process, fixture, free_port, paced, wait_until
from tests.helpers.paths import ROOT

PROMTOOL, PROMETHEUS = shutil.which("promtool"), shutil.which("prometheus")
RULES, CONFIG = config_folder() / "prometheus-alerts.yml", config_folder() / "prometheus.yml"
DASHBOARD = json.loads((config_folder() / "grafana-dashboard.json").read_text(encoding="utf-8"))
STORIES = Path(__file__).parent / "alerts_test.yml"
PORT = "14599"  # that the shipped files name
has_promtool = pytest.mark.skipif(PROMTOOL is None, reason="there is no promtool: Debian's prometheus brings it")
has_prometheus = pytest.mark.skipif(PROMETHEUS is None, reason="there is no prometheus: Debian has it")

# Grafana's variables, as it fills them in where nothing was chosen.
_FILLED = {"$instance": ".*", "$link": ".*", "$vehicle": ".*", "$check": ".*", "$__rate_interval": "20s"}


def filled(query: str) -> str:
    for name, value in _FILLED.items():
        query = query.replace(name, value)
    return query


def targets() -> Iterator[tuple[str, str]]:
    """Each panel's title and query, and those of the variables and annotations."""
    for panel in DASHBOARD["panels"]:
        yield from ((panel["title"], target["expr"]) for target in panel.get("targets", []))
    yield from (("annotations", one["expr"]) for one in DASHBOARD["annotations"]["list"])


def page_queries() -> list[str]:
    """Those of the page's table."""
    section = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8").split("## Questions and their queries")[1]
    return re.findall(r"^\|[^|`]+\| `(.+)` \|$", section.split("\n## ")[0], re.MULTILINE)


# --- what is shipped -------------------------------------------------------------------------------------------------


def test_every_alert_has_a_story() -> None:
    """One that fires it, in `alerts_test.yml`; and the page lists it with its severity."""
    rules = re.findall(r"- alert: (\w+)\n(?:.*\n)*?\s+severity: (\w+)", RULES.read_text())
    assert len(rules) == RULES.read_text().count("- alert: ") == 10
    stories = STORIES.read_text()
    page = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
    for alert, severity in rules:
        assert re.search(rf"alertname: {alert}\n\s+exp_alerts:", stories), alert
        assert f"| `{alert}` | {severity} |" in page, alert


def test_the_shipped_files_name_one_port() -> None:
    """What is typed on the page, and what Prometheus is told to read."""
    assert f'targets: ["127.0.0.1:{PORT}"]' in CONFIG.read_text()
    assert f"--metrics {PORT} " in CONFIG.read_text()
    assert f"--metrics {PORT} " in (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")


def test_the_dashboard_is_whole() -> None:
    """Every panel has its own id and place, a source that is chosen, a description and a query; variables exist."""
    assert DASHBOARD["uid"] == "gcs-bridge"
    assert DASHBOARD["id"] is None
    panels = DASHBOARD["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    taken: set[tuple[int, int]] = set()
    for panel in panels:
        at = panel["gridPos"]
        cells = {(at["x"] + x, at["y"] + y) for x in range(at["w"]) for y in range(at["h"])}
        assert max(x for x, _ in cells) < 24
        assert not cells & taken, panel["title"]
        taken |= cells
        if panel["type"] != "row":
            assert panel["datasource"]["uid"] == "${datasource}"
            assert panel["description"]
            assert panel["targets"]
    names = {variable["name"] for variable in DASHBOARD["templating"]["list"]}
    used = set(re.findall(r"\$\{?([a-z]+)", json.dumps([panels, DASHBOARD["annotations"]])))
    assert used <= names


@pytest.mark.slow
@has_promtool
@pytest.mark.parametrize(
    "command", [("check", "rules", str(RULES)), ("check", "config", str(CONFIG)), ("test", "rules", str(STORIES))]
)
def test_promtool_takes_it(command: tuple[str, ...]) -> None:
    """The rules, the configuration, and that each alert fires on what it is for and not on what it is not for."""
    done = subprocess.run([str(PROMTOOL), *command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


# --- while it runs ---------------------------------------------------------------------------------------------------


class Prometheus:
    """A Prometheus with the shipped configuration, but for its ports and for how often it reads."""

    def __init__(self, folder: Path, target: int) -> None:
        self.port = free_port(socket.SOCK_STREAM)
        text = CONFIG.read_text().replace(PORT, str(target)).replace("_interval: 5s", "_interval: 1s")
        (folder / "prometheus.yml").write_text(text)
        shutil.copy(RULES, folder)
        options = (
            f"--config.file={folder / 'prometheus.yml'}",
            f"--storage.tsdb.path={folder / 'data'}",
            f"--web.listen-address=127.0.0.1:{self.port}",
            "--log.level=error",
        )
        self._process = subprocess.Popen([str(PROMETHEUS), *options], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        wait_until(self._is_ready, 60)

    def _is_ready(self) -> bool:
        assert self._process.poll() is None, self._process.communicate()
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/-/ready", timeout=5):
                return True
        except (urllib.error.URLError, ConnectionError, TimeoutError):
            time.sleep(0.1)
            return False

    def get(self, path: str, **parameters: str) -> Any:
        query = urllib.parse.urlencode(parameters)
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/api/v1/{path}?{query}", timeout=20) as answer:
                return json.load(answer)["data"]
        except urllib.error.HTTPError as error:
            pytest.fail(f"{parameters}: {error.read().decode()}")

    def query(self, query: str) -> list[dict[str, Any]]:
        result: list[dict[str, Any]] = self.get("query", query=query)["result"]
        return result

    def firing(self) -> set[str]:
        return {one["labels"]["alertname"] for one in self.get("alerts")["alerts"] if one["state"] == "firing"}

    def __enter__(self) -> "Prometheus":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.communicate()


@pytest.mark.slow
@has_prometheus
def test_prometheus_reads_the_bridge(tmp_path: Path) -> None:
    """A flight with a fault over UDP: it is read, the alert fires, no counter goes back, every query has its answer."""
    target, link = free_port(socket.SOCK_STREAM), free_port()
    healthy = fixture("d_plane_pitchtrim3", to_s=8)
    faulty = fixture("d_plane_pitchtrim3", from_s=8, to_s=17, fault="yaw_offset:25")
    with ExitStack() as stack:
        options = ("--viewer", "none", "--metrics", str(target))
        process = stack.enter_context(Process("listen", f"udpin:127.0.0.1:{link}", *options))
        process.wait_for("link up")
        prometheus = stack.enter_context(Prometheus(tmp_path, target))
        sender = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))

        def send(data: bytes) -> None:
            sender.sendto(data, ("127.0.0.1", link))

        paced(healthy, send, 8)
        wait_until(lambda: bool(prometheus.query("gcs_bridge_alarms_total == 0")), 30)
        flight = threading.Thread(target=paced, args=(faulty, send, 4))
        flight.start()
        stack.callback(flight.join)
        wait_until(lambda: "GcsBridgeAlarm" in prometheus.firing(), 30)
        assert "GcsBridgeDown" not in prometheus.firing()
        (state,) = prometheus.query('gcs_bridge_alarm_state{check="euler_quaternion", state="alarm"}')
        assert state["value"][1] == "1"
        assert state["metric"]["vehicle"] == "1.1"
        assert state["metric"]["link"] == f"udpin:127.0.0.1:{link}"
        (residual,) = prometheus.query('gcs_bridge_residual_degrees{check="euler_quaternion", alarm="pairs"}')
        assert float(residual["value"][1]) == pytest.approx(25.0, abs=0.5)
        for family in FAMILIES:
            if family.counts:
                assert prometheus.query(f"resets({family.full_name}[5m]) > 0") == []
        unanswered = {title for title, query in targets() if not prometheus.query(filled(query))}
        assert unanswered <= {"Frames lost", "annotations"}
        shown = {
            one["metric"]["check"]: one["value"][1]
            for one in prometheus.query(filled(dict(targets())["Checks over time"]))
        }
        assert shown["euler_quaternion"] == "6"  # which the panel writes as ALARM
        assert shown["quaternion_norm"] == "0"
        for query in page_queries():
            prometheus.query(query)
        for variable in DASHBOARD["templating"]["list"][1:]:
            of, label = re.fullmatch(r"label_values\((.+), (\w+)\)", filled(variable["query"]["query"])).groups()  # type: ignore[union-attr]
            assert prometheus.get(f"label/{label}/values", **{"match[]": of})
