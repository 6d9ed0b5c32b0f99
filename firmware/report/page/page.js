// The plots of a report. The data stand in #data (config/SPEC.md, "The report"); the tables are complete without this.
"use strict";
(() => {
    const data = JSON.parse(document.getElementById("data").textContent);
    const live = data.origin !== null;
    const QUALITIES = ["good", "stale", "out of range", "not a number", "no link", "outlier", "frozen"]; // codes of tl_quality
    const COLOURS = ["ink", "soft", "line", "grid", "simulated", "measured", "nominal", "difference", "band", "bad", "gap", "info",
        "warning", "error"];
    const PRINT_WIDTH = 670; // CSS pixels: fits A4 and Letter between the margins of page.css
    const root = document.documentElement;
    const container = document.getElementById("plots");
    const plots = [];
    let palette = {};
    let busy = false; // while the window of one plot is copied to the others

    // ---- Time --------------------------------------------------------------------------------------------------------

    // The axis at the beginning of a step, counted from the first: seconds since t_start, or milliseconds of UTC.
    function timeOf(position) {
        const seconds = (data.first + position) * data.step;
        return live ? data.origin + seconds * 1e3 : seconds;
    }

    // The step that a point stands for: where the curves are thinned, two points share a bucket.
    function positionOf(index) {
        if (data.width === 1) {
            return index;
        }
        return Math.min(Math.floor(index / 2) * data.width + (index % 2) * data.width / 2, data.steps - 1);
    }

    function pointsOf(bucket) {
        return data.width === 1 ? [bucket, bucket] : [2 * bucket, 2 * bucket + 1];
    }

    const whole = [timeOf(0), timeOf(data.steps)];

    // The zone of the reader's clock at an instant, for example "GMT+1".
    function zoneAt(at) {
        const parts = new Intl.DateTimeFormat("en", {timeZoneName: "short"}).formatToParts(at);
        return parts.find((part) => part.type === "timeZoneName").value;
    }

    // "2026-11-21 10:02:03.456" by the reader's clock.
    function localTime(at) {
        return new Date(at - new Date(at).getTimezoneOffset() * 6e4).toISOString().replace("T", " ").replace("Z", "");
    }

    function describeTime(x) {
        return live ? localTime(x) + " " + zoneAt(x) : "t = " + number(x, 9) + " s";
    }

    // Replaces UTC in a text; `day`: the date of a time without date.
    function localText(text, day) {
        return text.replace(/(?:(\d{4}-\d\d-\d\d) )?(\d\d:\d\d)(:\d\d)? UTC/g, (found, date, minutes, seconds = "") => {
            const at = Date.parse((date || day) + "T" + minutes + (seconds || ":00") + "Z");
            if (Number.isNaN(at)) {
                return found;
            }
            const [localDay, time] = localTime(at).split(" ");
            return (date || localDay !== day ? localDay + " " : "") + time.slice(0, seconds ? 8 : 5) + " " + zoneAt(at);
        });
    }

    function showLocalTimes() {
        const day = new Date(timeOf(data.steps)).toISOString().slice(0, 10);
        for (const cell of document.querySelectorAll(".facts dd, #changes td, #events td")) {
            const text = localText(cell.textContent, day);
            if (text !== cell.textContent && cell.childElementCount === 0) {
                cell.title = cell.textContent;
                cell.textContent = text;
            }
        }
    }

    // ---- Numbers -----------------------------------------------------------------------------------------------------

    function number(value, digits) {
        return String(Number(value.toPrecision(digits))).replace("-", "\u2212");
    }

    function describe(series, value) {
        if (value === null || value === undefined) {
            return "\u2013";
        }
        if (series.type === "Boolean") {
            return value === 0 ? "false" : "true";
        }
        return number(value, 6) + (series.unit ? "\u00a0" + series.unit : "");
    }

    // As many digits as the range needs.
    function tick(value, graph) {
        const [low, high] = graph.yAxisRange();
        const digits = Math.max(0, Math.ceil(-Math.log10(high - low)) + 1);
        const text = Math.abs(value) >= 1e6 || digits > 5
            ? String(Number(value.toPrecision(4)).toExponential())
            : value.toFixed(digits);
        return value === 0 ? "0" : text.replace("-", "\u2212");
    }

    // A count has no ticks between whole numbers.
    function wholeTicks(low, high) {
        const room = (high - low) / 4;
        const power = 10 ** Math.floor(Math.log10(Math.max(room, 1)));
        const distance = [1, 2, 5, 10].map((factor) => factor * power).find((one) => one >= room) || 1;
        const found = [];
        for (let v = Math.ceil(low / distance) * distance; v <= high; v += distance) {
            found.push(v);
        }
        return found;
    }

    // ---- Colours -----------------------------------------------------------------------------------------------------

    function readPalette() {
        const style = getComputedStyle(root);
        palette = Object.fromEntries(COLOURS.map((name) => [name, style.getPropertyValue("--" + name).trim()]));
    }

    function paint(plot) {
        const series = {};
        for (const one of plot.series) {
            series[one.label] = {
                color: palette[one.colour], strokeWidth: one.width, strokePattern: one.dash || null, stepPlot: one.stepped,
                highlightCircleSize: one.name ? 3 : 0,
            };
        }
        return {series, axisLineColor: palette.line, gridLineColor: palette.grid};
    }

    // ---- Behind the curves -------------------------------------------------------------------------------------------

    function hatch(context, area, from, to, colour) {
        const left = Math.max(from, area.x);
        const right = Math.min(Math.max(to, from + 3), area.x + area.w);
        if (right <= left) {
            return;
        }
        if (right - left < 7) { // too narrow for a hatch to be seen
            context.fillStyle = colour;
            context.fillRect(left, area.y, right - left, area.h);
            return;
        }
        context.save();
        context.beginPath();
        context.rect(left, area.y, right - left, area.h);
        context.clip();
        context.strokeStyle = colour;
        context.lineWidth = 1;
        context.beginPath();
        for (let x = area.x - area.h - (area.x % 7); x < right; x += 7) {
            if (x + area.h >= left) {
                context.moveTo(x, area.y + area.h);
                context.lineTo(x + area.h, area.y);
            }
        }
        context.stroke();
        context.restore();
    }

    function drawStretches(context, area, graph, stretches, colour) {
        for (const [from, to] of stretches) {
            hatch(context, area, graph.toDomXCoord(from), graph.toDomXCoord(to), colour);
        }
    }

    function drawEvents(context, area, graph) {
        for (const event of events) {
            const x = Math.round(graph.toDomXCoord(event.time)) + 0.5;
            if (x < area.x || x > area.x + area.w) {
                continue;
            }
            context.strokeStyle = context.fillStyle = palette[event.severity] || palette.info;
            context.lineWidth = 1;
            context.setLineDash(event.severity === "info" ? [2, 3] : []);
            context.beginPath();
            context.moveTo(x, area.y);
            context.lineTo(x, area.y + area.h);
            context.stroke();
            context.beginPath();
            context.moveTo(x - 4, area.y);
            context.lineTo(x + 4, area.y);
            context.lineTo(x, area.y + 6);
            context.fill();
        }
        context.setLineDash([]);
    }

    // A line where a change began, with its number.
    function drawFindings(context, area, graph) {
        for (const finding of findings) {
            const x = Math.round(graph.toDomXCoord(finding.time));
            if (x < area.x || x > area.x + area.w) {
                continue;
            }
            context.strokeStyle = context.fillStyle = finding.open ? palette.error : palette.soft;
            context.lineWidth = 2;
            context.beginPath();
            context.moveTo(x, area.y);
            context.lineTo(x, area.y + area.h);
            context.stroke();
            context.font = "600 12px system-ui, sans-serif";
            context.fillText(finding.number, x + 4, area.y + area.h - 5);
        }
    }

    function drawBehind(plot, context, area, graph) {
        if (plot.tolerance) {
            const top = graph.toDomYCoord(plot.tolerance);
            context.fillStyle = palette.band;
            context.fillRect(area.x, top, area.w, graph.toDomYCoord(-plot.tolerance) - top);
        }
        drawStretches(context, area, graph, gaps, palette.gap);
        drawStretches(context, area, graph, plot.bad, palette.bad);
        drawEvents(context, area, graph);
        drawFindings(context, area, graph);
    }

    // ---- Legend ------------------------------------------------------------------------------------------------------

    function element(name, type, text) {
        const made = document.createElement(name);
        made.className = type;
        made.textContent = text || "";
        return made;
    }

    function swatch(series) {
        const drawing = document.createElementNS("http://www.w3.org/2000/svg", "svg");
        const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
        const attributes = {x1: "0%", x2: "100%", y1: "50%", y2: "50%", "stroke-width": series.width + 0.5,
            "stroke-dasharray": (series.dash || []).join(" "), style: "stroke: var(--" + series.colour + ")"};
        for (const [key, value] of Object.entries(attributes)) {
            line.setAttribute(key, value);
        }
        drawing.setAttribute("aria-hidden", "true");
        drawing.append(line);
        return drawing;
    }

    function legend(plot) {
        const caption = element("figcaption", "");
        for (const series of plot.series.filter((one) => one.name)) {
            const entry = element("span", "entry");
            series.shown = element("b", "");
            entry.append(swatch(series), element("span", "name", series.name), " ", series.shown);
            caption.append(entry);
        }
        if (plot.hint) {
            caption.append(element("span", "hint", plot.hint));
        }
        plot.at = element("span", "at");
        caption.append(plot.at);
        return caption;
    }

    // The row nearest to a time.
    function nearest(times, x) {
        let low = 0;
        let high = times.length - 1;
        while (high - low > 1) {
            const middle = (low + high) >> 1;
            if (times[middle] <= x) {
                low = middle;
            } else {
                high = middle;
            }
        }
        return x - times[low] <= times[high] - x ? low : high;
    }

    // The value at a time: for curves that are constant over a step, the last row at or before it.
    function rowAt(plot, x) {
        const row = nearest(plot.times, x);
        return plot.offset === 0 && row > 0 && plot.times[row] > x ? row - 1 : row;
    }

    function badAt(plot, x) {
        const found = plot.bad.find(([from, to]) => x >= from && x <= to);
        return found ? found[2] : "";
    }

    function showCursor(x, from) {
        for (const plot of plots.filter((one) => one === from || !(from.trend || one.trend))) {
            const row = rowAt(plot, x);
            if (plot !== from) {
                plot.graph.setSelection(row);
            }
            for (const series of plot.series.filter((one) => one.shown)) {
                const value = series.values[Math.min(row, series.values.length - 1)];
                const bad = value === null && series.colour === "measured" ? badAt(plot, x) : "";
                series.shown.textContent = bad || describe(series, value);
            }
            plot.at.textContent = describeTime(plot.times[row]);
        }
    }

    function hideCursor() {
        for (const plot of plots) {
            plot.graph.clearSelection();
            plot.at.textContent = "";
            for (const series of plot.series.filter((one) => one.shown)) {
                series.shown.textContent = "";
            }
        }
    }

    // ---- Zoom --------------------------------------------------------------------------------------------------------

    function follow(graph, initial) {
        if (busy || initial) {
            return;
        }
        const dateWindow = graph.xAxisRange();
        busy = true;
        for (const plot of plots.filter((one) => one.graph !== graph && !one.trend)) {
            plot.graph.updateOptions({dateWindow});
        }
        busy = false;
    }

    function showWhole() {
        busy = true;
        for (const plot of plots) {
            plot.graph.updateOptions({dateWindow: plot.window, valueRange: plot.range});
        }
        busy = false;
    }

    // One finger scrolls the page, two zoom.
    function interaction() {
        const usual = Dygraph.defaultInteractionModel;
        return {...usual, dblclick: showWhole, touchstart: (event, graph, context) => {
            if (event.touches.length > 1) {
                usual.touchstart(event, graph, context);
            }
        }};
    }

    // ---- Plots -------------------------------------------------------------------------------------------------------

    // Units are the FMU's, and the library takes labels as HTML.
    function escaped(text) {
        const made = document.createElement("span");
        made.textContent = text;
        return made.innerHTML;
    }

    function rowsOf(plot) {
        const count = plot.series[0].values.length;
        if (plot.trend) {
            plot.times = plot.trend.map((_, index) => trendTime(index + 0.5));
            return plot.trend.map((part, index) => [live ? new Date(plot.times[index]) : plot.times[index], part]);
        }
        plot.times = Array.from({length: count}, (_, index) => timeOf(positionOf(index) + plot.offset));
        const stepped = plot.offset === 0;
        if (stepped) {
            plot.times.push(whole[1]); // the last value is also constant for a step
        }
        return plot.times.map((time, index) => {
            const at = Math.min(index, count - 1);
            return [live ? new Date(time) : time, ...plot.series.map((one) => one.values[at])];
        });
    }

    function options(plot) {
        const y = {axisLabelWidth: 58, pixelsPerLabel: 24, axisLabelFormatter: (value, _, __, graph) => tick(value, graph)};
        if (plot.boolean) {
            y.ticker = () => [{v: 0, label: "false"}, {v: 1, label: "true"}];
        } else if (plot.counts) {
            y.ticker = (low, high) => wholeTicks(Math.max(0, low), high).map((v) => ({v, label: String(v)}));
        }
        return {
            ...paint(plot), labels: ["t", ...plot.series.map((one) => one.label)], legend: "never",
            includeZero: plot.counts || plot.zero, xLabelHeight: 15, yLabelWidth: 16,
            ylabel: escaped(plot.unit) || "\u00a0", xlabel: live ? zoneAt(whole[0]) : "time in s",
            axes: {x: {axisLabelWidth: 70, pixelsPerLabel: 80}, y}, axisLabelFontSize: 12, rightGap: 12, yRangePad: 8,
            dateWindow: plot.window, valueRange: plot.range, animatedZooms: false, customBars: Boolean(plot.trend), fillAlpha: 0.25,
            interactionModel: interaction(), drawCallback: plot.trend ? null : follow, unhighlightCallback: hideCursor,
            highlightCallback: (event, x) => showCursor(x, plot),
            underlayCallback: (context, area, graph) => drawBehind(plot, context, area, graph),
        };
    }

    function addPlot(group, description) {
        const plot = {bad: [], range: [null, null], window: whole, unit: "", counts: false, zero: false, ...description};
        plot.series.forEach((one, index) => {
            one.label = "s" + index;
            one.width = one.width || 1.4;
        });
        if (plot.boolean) {
            plot.range = [-0.15, 1.15];
        }
        const figure = element("figure", "");
        const canvas = element("div", "plot");
        canvas.style.height = plot.height + "px";
        canvas.setAttribute("role", "img");
        canvas.setAttribute("aria-label", plot.series.filter((one) => one.name).map((one) => one.name).join(", "));
        figure.append(legend(plot), canvas);
        group.append(figure);
        plot.canvas = canvas;
        plot.graph = new Dygraph(canvas, rowsOf(plot), options(plot));
        plots.push(plot);
    }

    function addGroup(title) {
        const group = element("section", "group");
        group.append(element("h3", "", title));
        container.append(group);
        return group;
    }

    // A range without rare extremes, such as those of a start, if they would flatten the rest; null: all is shown.
    function usualRange(values) {
        const sorted = values.filter((one) => one !== null).sort((one, other) => one - other);
        if (sorted.length < 50) {
            return null;
        }
        const at = (share) => sorted[Math.round(share * (sorted.length - 1))];
        const [low, high] = [at(0.02), at(0.98)];
        const span = high - low;
        return span > 0 && sorted.at(-1) - sorted[0] > 4 * span ? [low - span / 2, high + span / 2] : null;
    }

    function constant(value, like) {
        return like.map(() => value);
    }

    // ---- What is plotted ---------------------------------------------------------------------------------------------

    function namesOf(mask) {
        return QUALITIES.filter((_, code) => mask & (1 << code)).join(", ");
    }

    // [from, to, qualities] on the axis of the outputs; a value belongs to the end of its step.
    function badStretches(match) {
        return match.bad.map(([first, last, mask]) => [
            timeOf(positionOf(pointsOf(first)[0]) + 0.5), timeOf(Math.min((last + 1) * data.width, data.steps) + 0.5),
            namesOf(mask),
        ]);
    }

    function addMatch(match) {
        const group = addGroup(match.name);
        const bad = badStretches(match);
        const seen = match.bad.reduce((all, [, , mask]) => all | mask, 0);
        const stepped = match.type !== "Real";
        const {unit, type} = match;
        const released = (match.released || []).some((one) => one !== null)
            ? [{name: "y without corrections (released twin)", values: match.released, colour: "nominal", width: 1.2, dash: [6, 3],
                stepped, unit, type}] : [];
        addPlot(group, {
            unit, bad, offset: 1, height: 240, boolean: type === "Boolean",
            hint: seen ? "hatched: \u0177 is not good (" + namesOf(seen) + ") and not used" : "",
            series: [
                {name: "\u0177 measured, " + match.to, values: match.measured, colour: "measured", width: 3.2, stepped, unit,
                    type},
                {name: "y simulated", values: match.simulated, colour: "simulated", width: 1.3, stepped, unit, type},
                ...released,
            ],
        });
        const series = [{name: "error \u0394y = y \u2212 \u0177", values: match.error, colour: "difference", stepped, unit}];
        if (match.tolerance > 0) {
            for (const limit of [match.tolerance, -match.tolerance]) {
                series.push({values: constant(limit, match.error), colour: "nominal", width: 0.8, dash: [4, 3]});
            }
        }
        addPlot(group, {
            unit, bad, offset: 1, height: 170, series, tolerance: match.tolerance,
            hint: match.tolerance > 0 ? "band: tolerance \u00b1" + number(match.tolerance, 6) + " " + unit : "",
        });
    }

    // The axis at a part of the trend, which covers all runs.
    function trendTime(part) {
        return (data.trend.from + part * data.trend.width) / (live ? 1 : 1e3);
    }

    function addTrend(group, adjust) {
        const {unit, trend} = adjust;
        const usual = usualRange(trend.flatMap((part) => [part[0], part[2]]));
        addPlot(group, {
            unit, trend, offset: 0, height: 170, range: usual || [null, null], window: [trendTime(0), trendTime(trend.length)],
            hint: "all runs, each " + number(data.trend.width / 6e4, 4) + "\u00a0min; band: standard deviation",
            series: [{name: "mean correction \u0394u", values: trend.map((part) => part[1]), colour: "difference", width: 2, unit}],
        });
    }

    function addAdjusted(adjust) {
        const group = addGroup(adjust.name);
        const {unit, type} = adjust;
        if (adjust.trend) {
            addTrend(group, adjust);
        }
        addPlot(group, {
            unit, offset: 0, height: 170, boolean: type === "Boolean",
            series: [
                {name: "\u00fb nominal", values: adjust.nominal, colour: "nominal", width: 2.6, stepped: true, unit, type},
                {name: "u applied", values: adjust.applied, colour: "simulated", stepped: true, unit, type},
            ],
        });
        const usual = usualRange(adjust.correction);
        addPlot(group, {
            unit, offset: 0, height: 170, range: usual || [null, null], hint: usual ? "rare extremes lie outside" : "",
            series: [{name: "correction \u0394u = u \u2212 \u00fb", values: adjust.correction, colour: "difference", stepped: true, unit}],
        });
    }

    function addEffort() {
        addPlot(addGroup("Search effort"), {
            offset: 0, height: 170, unit: "per step", counts: true,
            series: [
                {name: "evaluations", values: data.evaluations, colour: "measured", stepped: true},
                {name: "executions of components", values: data.executions, colour: "simulated", width: 1.2, stepped: true},
            ],
        });
    }

    function addBudget() {
        const series = [{name: "computing time", values: data.used, colour: "simulated", stepped: true, unit: "ms"}];
        if (data.budget > 0) {
            series.push({name: "time budget of the search " + number(data.budget, 4) + " ms", dash: [6, 4], width: 1.2,
                values: constant(data.budget, data.used), colour: "warning"});
        }
        const period = data.step * 1e3;
        series.push({name: "macro step " + number(period, 4) + " ms", dash: [2, 3], width: 1.2,
            values: constant(period, data.used), colour: "error"});
        addPlot(addGroup("Computing time of a step"), {offset: 0, height: 170, unit: "ms", zero: true, series});
    }

    // Ranges without a step: lost, removed, or never recorded.
    function findGaps() {
        const found = [];
        const missing = (index) => data.executions[index] === null;
        for (let index = 0; index < data.executions.length; index++) {
            if (missing(index)) {
                const first = index;
                while (index + 1 < data.executions.length && missing(index + 1)) {
                    index++;
                }
                found.push([timeOf(positionOf(first)), timeOf(positionOf(index) + 1)]);
            }
        }
        return found;
    }

    // ---- Paper -------------------------------------------------------------------------------------------------------

    function repaint() {
        readPalette();
        busy = true;
        plots.forEach((plot) => plot.graph.updateOptions(paint(plot)));
        busy = false;
    }

    // Light colours, the width of the paper, and as many dots as a printer has.
    function toPaper() {
        root.classList.add("print");
        document.querySelectorAll("details").forEach((one) => { one.open = true; });
        readPalette();
        busy = true;
        for (const plot of plots) {
            plot.graph.updateOptions({...paint(plot), pixelRatio: plots.length > 12 ? 2 : 3}, true);
            plot.canvas.style.width = PRINT_WIDTH + "px";
            plot.graph.resize(PRINT_WIDTH, plot.height);
        }
        busy = false;
    }

    function toScreen() {
        root.classList.remove("print");
        readPalette();
        busy = true;
        for (const plot of plots) {
            plot.canvas.style.width = "";
            plot.graph.updateOptions({...paint(plot), pixelRatio: null}, true);
            plot.graph.resize();
        }
        busy = false;
    }

    // ---- Begin -------------------------------------------------------------------------------------------------------

    const events = Array.from(document.querySelectorAll("#events tr[data-time]"), (row) => (
        {time: Number(row.dataset.time), severity: row.className}));
    const findings = Array.from(document.querySelectorAll("#changes tr[data-time]"), (row) => (
        {time: Number(row.dataset.time), open: row.className === "open", number: row.cells[0].textContent}));
    if (live) {
        showLocalTimes();
    }
    if (data.steps === 0) {
        container.append(element("p", "note", "There are no steps."));
        return;
    }
    const gaps = findGaps();
    if (gaps.length > 0) {
        container.append(element("p", "note", "Hatched in grey: steps that are not in the database."));
    }
    readPalette();
    data.match.forEach(addMatch);
    data.adjust.forEach(addAdjusted);
    addEffort();
    if (data.used) {
        addBudget();
    }
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
    addEventListener("beforeprint", toPaper);
    addEventListener("afterprint", toScreen);
    root.dataset.drawn = String(plots.length); // for programs that wait for the plots
})();
