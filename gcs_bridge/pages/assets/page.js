"use strict";
(function () {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue("--" + name).trim();
  const plots = [];

  // Two sets of rows with times of their own, as one: null where a set has no row at a time.
  function joined(one, other) {
    const times = Array.from(new Set([...one[0], ...other[0]])).sort((a, b) => a - b);
    const spread = (columns) => {
      const at = new Map(columns[0].map((t, i) => [t, i]));
      return columns.slice(1).map((values) => times.map((t) => (at.has(t) ? values[at.get(t)] : undefined)));
    };
    return { times, one: spread(one), other: spread(other) };
  }

  // A curve that turns from 180 to -180 is broken there, not drawn across.
  function unbroken(values) {
    const shown = values.slice();
    let before = null;
    for (let i = 0; i < shown.length; i++) {
      if (shown[i] === undefined) continue;
      if (before !== null && shown[i] !== null && Math.abs(shown[i] - before) > 180) shown[i] = null;
      else before = shown[i];
    }
    return shown;
  }

  function shade(spans) {
    return (plot) => {
      const { ctx, bbox } = plot;
      ctx.save();
      for (const span of spans) {
        const from = Math.max(plot.valToPos(span.from, "x", true), bbox.left);
        const to = span.to === null ? bbox.left + bbox.width : Math.min(plot.valToPos(span.to, "x", true), bbox.left + bbox.width);
        if (to < bbox.left || from > bbox.left + bbox.width) continue;
        ctx.globalAlpha = 0.16;
        ctx.fillStyle = colour(span.severity);
        ctx.fillRect(from, bbox.top, Math.max(to - from, 2), bbox.height);
      }
      ctx.restore();
    };
  }

  function plot(place, title, data, series, spans, more) {
    const figure = document.createElement("div");
    figure.className = "plot";
    figure.append(Object.assign(document.createElement("h4"), { textContent: title }));
    place.append(figure);
    const axis = { stroke: colour("faint"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line") } };
    const options = {
      width: Math.max(figure.clientWidth, 240),
      height: 180,
      scales: { x: { time: false }, ...more.scales },
      axes: [axis, { ...axis, size: 62, ...more.axis }],
      cursor: { sync: { key: place.dataset.id, setSeries: true }, drag: { x: true, y: false } },
      series: [{ label: "boot time, s" }, ...series],
      hooks: { drawClear: [shade(spans)] },
    };
    plots.push([new uPlot(options, data, figure), figure]);
  }

  const degrees = (value) => (value === null || value === undefined ? "–" : Number(value.toPrecision(4)) + "°");
  const line = (label, name, dash) => ({
    label, stroke: colour(name), width: 1.5, dash, points: { show: false }, spanGaps: false, value: (_, v) => degrees(v),
  });

  for (const boot of JSON.parse(document.getElementById("curves").textContent)) {
    const place = document.querySelector(`.plots[data-id="${boot.id}"]`);
    const { times, one, other } = joined(boot.euler, boot.quaternion);
    ["roll", "pitch", "yaw"].forEach((angle, i) => {
      const wraps = angle === "pitch" ? (v) => v : unbroken;
      const series = [line("quaternion", "quaternion"), line("Euler", "euler", [6, 4])];
      plot(place, angle + ", °", [times, wraps(other[i]), wraps(one[i])], series, boot.alarms, {});
    });
    // As powers of ten, so that both 0.01 and 90 can be read; what is less than a thousandth is drawn there.
    const floored = (values) => values.map((v) => (v === null ? null : Math.max(v, 0.001)));
    const [t, ...found] = boot.pairs;
    if (t.length) {
      const series = [
        line("disagreement", "quaternion"), line("limit", "limit", [2, 3]), line("tilt", "tilt", [8, 3]), line("heading", "heading", [3, 3]),
      ];
      plot(place, "disagreement, °", [t, ...found.map(floored)], series, boot.alarms, {
        scales: { y: { distr: 3, range: (_, low, high) => [0.001, Math.max(high, 1) * 1.5] } },
        axis: {
          filter: (_, ticks) => ticks.map((v) => (Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-6 ? v : null)),
          values: (_, ticks) => ticks.map((v) => (v === null ? "" : String(Number(v.toPrecision(1))))),
        },
      });
    }
  }

  const resize = () => plots.forEach(([drawn, figure]) => drawn.setSize({ width: Math.max(figure.clientWidth, 240), height: 180 }));
  addEventListener("resize", resize);
  addEventListener("beforeprint", resize);
})();
