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

  // Angles that go on past 180, and come back within it once they are well past: a heading that sways about south is
  // one curve. A curve beside another takes the same turns. Where one comes back it is broken, not drawn across.
  const PAST = 20;
  function unrolled(times, values, beside) {
    const shown = [];
    const breaks = [];
    let before = null;
    let since = null;
    let guide = null;
    values.forEach((value, at) => {
      guide = beside?.[at] ?? guide;
      if (value == null) return shown.push(value);
      const near = guide ?? before ?? value;
      let angle = value + 360 * Math.round((near - value) / 360);
      if (guide === null && Math.abs(angle) > 180 + PAST) angle = value;
      if (before !== null && Math.abs(angle - before) > 180) breaks.push([since, times[at]]);
      shown.push(angle);
      before = angle;
      since = times[at];
    });
    return { shown, breaks };
  }

  // What is not drawn of a curve, in pixels: beside its own gaps where it is broken, however near two samples are.
  const gaps = (breaks) => (plot, _, from, to, own) => {
    const all = [...own, ...breaks.map(([a, b]) => [plot.valToPos(a, "x", true) - 2, plot.valToPos(b, "x", true) + 2])];
    all.sort((a, b) => a[0] - b[0]);
    for (let i = 1; i < all.length; i++) all[i] = [Math.max(all[i][0], all[i - 1][1]), Math.max(all[i][1], all[i - 1][1])];
    return all;
  };

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
      const quaternion = unrolled(times, other[i]);
      const euler = unrolled(times, one[i], quaternion.shown);
      const series = [line("quaternion", "quaternion"), line("Euler", "euler", [6, 4])];
      [quaternion, euler].forEach(({ breaks }, which) => (series[which].gaps = gaps(breaks)));
      series.forEach((curve) => (curve.value = (_, v) => degrees(v == null ? v : ((v + 540) % 360) - 180)));
      plot(place, angle + ", °", [times, quaternion.shown, euler.shown], series, boot.alarms, {});
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
