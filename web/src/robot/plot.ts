/** Drawing of one parameter over time: sizes, colours and marks; the data come as columns. */

import uPlot from 'uplot';
import { colour } from '../ui/theme.svelte';
import { AXIS_FONT, logLabels, logLines, PADDING, timeLabels, valueLabels } from './axes';
import { type Columns, isolated, lonePlace } from './series';

const AXIS_WIDTH = 58;
const MARK_SIZE = 4.5;
const POINT_SIZE = 3.5;

/** A mark of an event. */
export interface EventMark {
  t_s: number;
  tone: 'bad' | 'ink' | 'quiet';
  /** Name of the event, in two or three words. */
  word: string;
  /** Details of the event; empty without any. */
  text?: string;
}

/** Line of another robot or time, in shown units. */
export interface OtherLine {
  /** Points, oldest first; the value is null where nothing is known. */
  points: readonly { t_s: number; value: number | null }[];
  word: string;
}

/** Form of the points and scale of the values. */
export interface Style {
  form: 'line' | 'dots';
  scale: 'linear' | 'log';
}

/** Lines beside the estimate, in shown units. */
export interface Levels {
  /** Applied values, as steps in time. */
  applied: readonly { t_s: number; value: number | null }[];
  /** Tolerance around the applied values; null without one. */
  tolerance: number | null;
  /** Value with its word, such as the proposed one; null without one. */
  level: { value: number; word: string } | null;
}

/** Interface from a chart to its page. */
export interface PlotHost {
  /** Duration that a point represents, s. */
  bucket_s(): number;
  /** Lowest and highest value now. */
  values(): [number, number];
  marks(): readonly EventMark[];
  levels(): Levels;
  /** Returns the stretches in which the value was not known. */
  unknown(): readonly [from_s: number, to_s: number][];
  /** Returns the line of another robot or time; null without one. */
  other(): OtherLine | null;
  /** Called when the cursor moved to a time, or left. */
  cursor(t_s: number | null): void;
  /** Called when a stretch of time was selected with the mouse. */
  cut(from_s: number, to_s: number): void;
}

/** Draws marks over the plot: a dashed line, and at its top a shape that distinguishes them. */
function drawMarks(
  plot: uPlot,
  marks: readonly EventMark[],
  colours: Record<string, string>,
): void {
  const { ctx, bbox } = plot;
  const ratio = devicePixelRatio;
  ctx.save();
  for (const { t_s, tone } of marks) {
    const x = plot.valToPos(t_s, 'x', true);
    if (x < bbox.left || x > bbox.left + bbox.width) continue;
    ctx.strokeStyle = ctx.fillStyle = colours[tone] ?? '';
    ctx.lineWidth = ratio;
    ctx.setLineDash([3 * ratio, 3 * ratio]);
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    ctx.setLineDash([]);
    drawShape(ctx, tone, x, bbox.top, MARK_SIZE * ratio);
  }
  ctx.restore();
}

/** Dots and dashes: applied values differ from the estimate without colour. */
const APPLIED_DASHES = [9, 3, 2, 3];
const PROPOSED_DASHES = [6, 4];
const OTHER_DASHES = [2, 2];

/** Returns start, end and height of each applied value, px. */
function appliedSpans(
  plot: uPlot,
  applied: Levels['applied'],
): [from: number, to: number, y: number][] {
  const { left, width } = plot.bbox;
  return applied.flatMap(({ t_s, value }, i) => {
    if (value === null) return [];
    const next = applied[i + 1];
    const from = Math.max(left, plot.valToPos(t_s, 'x', true));
    const to = next ? Math.min(left + width, plot.valToPos(next.t_s, 'x', true)) : left + width;
    return to > from ? [[from, to, plot.valToPos(value, 'y', true)]] : [];
  });
}

/** Draws the tolerance around applied values, under everything else. */
function drawTolerance(plot: uPlot, { applied, tolerance }: Levels, fill: string): void {
  if (tolerance === null) return;
  const half = Math.abs(plot.valToPos(tolerance, 'y', true) - plot.valToPos(0, 'y', true));
  clip(plot);
  plot.ctx.fillStyle = fill;
  for (const [from, to, y] of appliedSpans(plot, applied)) {
    plot.ctx.fillRect(from, y - half, to - from, 2 * half);
  }
  plot.ctx.restore();
}

/** Draws a word at the end of a line, over or under it; at the end of the axis on the other side. */
function drawLabel(
  plot: uPlot,
  text: string,
  [y, isOver]: [y: number, isOver: boolean],
  colours: LevelColours,
): void {
  const { ctx, bbox } = plot;
  const ratio = devicePixelRatio;
  const room = 20 * ratio;
  const over = isOver ? y - room > bbox.top : y + room > bbox.top + bbox.height;
  const at = [bbox.left + bbox.width - 4 * ratio, over ? y - room / 2 : y + room / 2] as const;
  ctx.font = AXIS_FONT.replace(/^\d+/, (size) => String(Number(size) * ratio));
  ctx.textAlign = 'right';
  ctx.textBaseline = 'middle';
  ctx.setLineDash([]);
  ctx.lineWidth = 4 * ratio;
  ctx.strokeStyle = colours.surface;
  ctx.fillStyle = colours.applied;
  ctx.strokeText(text, ...at);
  ctx.fillText(text, ...at);
}

/** Draws the applied values as a step line and another one as a level line, each with its word. */
function drawLevels(plot: uPlot, { applied, level }: Levels, colours: LevelColours): void {
  const { ctx, bbox } = plot;
  const right = bbox.left + bbox.width;
  const spans = appliedSpans(plot, applied);
  const dashes = (pattern: readonly number[]) => {
    ctx.setLineDash(pattern.map((length) => length * devicePixelRatio));
  };
  clip(plot);
  ctx.lineWidth = 1.5 * devicePixelRatio;
  ctx.strokeStyle = colours.applied;
  dashes(APPLIED_DASHES);
  ctx.beginPath();
  spans.forEach(([from, to, y], i) => {
    if (spans[i - 1]?.[1] === from) ctx.lineTo(from, y);
    else ctx.moveTo(from, y);
    ctx.lineTo(to, y);
  });
  ctx.stroke();
  const level_y = level === null ? null : plot.valToPos(level.value, 'y', true);
  const last = spans.at(-1);
  const applied_y = last && last[1] === right ? last[2] : null;
  // Each word is on the side that the other line is not on.
  const isAppliedOver = level_y === null || applied_y === null || applied_y <= level_y;
  if (applied_y !== null) drawLabel(plot, 'applied', [applied_y, isAppliedOver], colours);
  if (level !== null && level_y !== null) {
    const y = level_y;
    ctx.lineWidth = 1.5 * devicePixelRatio;
    ctx.strokeStyle = colours.proposed;
    dashes(PROPOSED_DASHES);
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(right, y);
    ctx.stroke();
    drawLabel(plot, level.word, [y, !isAppliedOver || applied_y === null], colours);
  }
  ctx.restore();
}

/** Draws the line of another robot or time, thinner than the estimate, with its word at its end. */
function drawOther(plot: uPlot, { points, word }: OtherLine, colours: LevelColours): void {
  const { ctx, bbox } = plot;
  clip(plot);
  ctx.lineWidth = 1.5 * devicePixelRatio;
  ctx.strokeStyle = colours.applied;
  ctx.setLineDash(OTHER_DASHES.map((length) => length * devicePixelRatio));
  ctx.beginPath();
  let isDown = false;
  let end: number | undefined;
  for (const { t_s, value } of points) {
    if (value === null) {
      isDown = false;
      continue;
    }
    const x = plot.valToPos(t_s, 'x', true);
    const y = plot.valToPos(value, 'y', true);
    if (isDown) ctx.lineTo(x, y);
    else ctx.moveTo(x, y);
    isDown = true;
    if (x >= bbox.left && x <= bbox.left + bbox.width) end = y;
  }
  ctx.stroke();
  if (end !== undefined) drawLabel(plot, word, [end, true], colours);
  ctx.restore();
}

/** Draws a row of dots along the axis where the value was not known. */
function drawUnknown(
  plot: uPlot,
  stretches: readonly [from_s: number, to_s: number][],
  stroke: string,
): void {
  const { ctx, bbox } = plot;
  const y = bbox.top + bbox.height - 4 * devicePixelRatio;
  clip(plot);
  ctx.lineCap = 'round';
  ctx.lineWidth = 2 * devicePixelRatio;
  ctx.strokeStyle = stroke;
  ctx.setLineDash([0, 6 * devicePixelRatio]);
  for (const [from_s, to_s] of stretches) {
    ctx.beginPath();
    ctx.moveTo(plot.valToPos(from_s, 'x', true), y);
    ctx.lineTo(plot.valToPos(to_s, 'x', true), y);
    ctx.stroke();
  }
  ctx.restore();
}

/** Restricts drawing to the inside of the axes, until `restore`. */
function clip({ ctx, bbox }: uPlot): void {
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
}

/** Draws points without a neighbour, each with its band and bucket: a line would not show them. */
function drawIsolated(plot: uPlot, bucket_s: number, stroke: string): void {
  const { ctx } = plot;
  const [times, top, bottom, , , mean] = plot.data as Columns;
  const end_s = plot.scales.x?.max ?? Number.POSITIVE_INFINITY;
  clip(plot);
  ctx.fillStyle = ctx.strokeStyle = stroke;
  ctx.lineWidth = 1.5 * devicePixelRatio;
  for (const i of isolated(plot.data as Columns)) {
    const place = lonePlace(times[i] ?? 0, bucket_s, end_s);
    const [from, x, to] = place.map((t_s) => plot.valToPos(t_s, 'x', true)) as typeof place;
    const y = (value: number | null | undefined) => plot.valToPos(value ?? 0, 'y', true);
    ctx.beginPath();
    ctx.moveTo(x, y(top[i]));
    ctx.lineTo(x, y(bottom[i]));
    ctx.moveTo(from, y(mean[i]));
    ctx.lineTo(to, y(mean[i]));
    ctx.stroke();
    ctx.beginPath();
    ctx.arc(x, y(mean[i]), POINT_SIZE * devicePixelRatio, 0, 2 * Math.PI);
    ctx.fill();
  }
  ctx.restore();
}

interface LevelColours {
  applied: string;
  proposed: string;
  /** Background of a word that stands over lines. */
  surface: string;
}

function drawShape(
  ctx: CanvasRenderingContext2D,
  tone: EventMark['tone'],
  x: number,
  y: number,
  size: number,
): void {
  ctx.beginPath();
  if (tone === 'bad') {
    ctx.moveTo(x, y - size);
    ctx.lineTo(x + size, y);
    ctx.lineTo(x, y + size);
    ctx.lineTo(x - size, y);
    ctx.closePath();
  } else if (tone === 'ink') {
    ctx.rect(x - size * 0.8, y - size * 0.8, size * 1.6, size * 1.6);
  } else {
    ctx.arc(x, y, size * 0.7, 0, 2 * Math.PI);
  }
  ctx.fill();
}

/** Returns the same colour, more or less transparent. */
function faded(rgb: string, alpha: number): string {
  return rgb.replace(/^rgb\((.*)\)$/, `rgba($1, ${alpha})`);
}

/** Draws `columns` into `element` in the current colours: a new theme needs a new plot. */
export function plot(
  element: HTMLElement,
  size: { width: number; height: number },
  columns: Columns,
  host: PlotHost,
  style: Style = { form: 'line', scale: 'linear' },
): uPlot {
  const accent = colour('--accent');
  const colours = { bad: colour('--bad'), ink: colour('--ink'), quiet: colour('--ink-faint') };
  const levelColours = {
    applied: colour('--ink'),
    proposed: colour('--accent'),
    surface: colour('--surface'),
  };
  const axis: uPlot.Axis = {
    stroke: colours.quiet,
    font: AXIS_FONT,
    grid: { stroke: colour('--line'), width: 1 },
    ticks: { show: false },
    gap: 6,
  };
  const hidden: uPlot.Series = { width: 0, points: { show: false } };
  const options: uPlot.Options = {
    ...size,
    padding: [...PADDING],
    legend: { show: false },
    scales: { x: { time: true }, y: { range: () => host.values(), ...distribution(style) } },
    axes: [
      {
        ...axis,
        size: 26,
        space: 74,
        values: (_, splits, __, ___, step) => timeLabels(splits, step),
      },
      {
        ...axis,
        size: AXIS_WIDTH,
        space: 36,
        ...(style.scale === 'log'
          ? { grid: { ...axis.grid, filter: (_, splits) => logLines(splits) } }
          : {}),
        values: (_, splits, __, ___, step) =>
          style.scale === 'log' ? logLabels(splits) : valueLabels(splits, step),
      },
    ],
    series: [
      {},
      { ...hidden },
      { ...hidden },
      { ...hidden },
      { ...hidden },
      style.form === 'line'
        ? { stroke: accent, width: 2, points: { show: false } }
        : { stroke: accent, width: 0, points: { show: true, size: 4, width: 0, fill: accent } },
    ],
    bands: [
      { series: [1, 2], fill: faded(accent, 0.16) },
      { series: [3, 4], fill: faded(accent, 0.32) },
    ],
    cursor: {
      y: false,
      sync: { key: 'robot' },
      points: { show: (_, series) => (series === 5 ? cursorPoint(accent) : (undefined as never)) },
      drag: { x: true, y: false, setScale: false },
    },
    hooks: {
      drawAxes: [(u) => drawTolerance(u, host.levels(), faded(levelColours.applied, 0.07))],
      draw: [
        (u) => drawUnknown(u, host.unknown(), colours.quiet),
        (u) => {
          if (style.form === 'line') drawIsolated(u, host.bucket_s(), accent);
        },
        (u) => {
          const other = host.other();
          if (other) drawOther(u, other, levelColours);
        },
        (u) => drawLevels(u, host.levels(), levelColours),
        (u) => drawMarks(u, host.marks(), colours),
      ],
      setCursor: [
        (u) => host.cursor(u.cursor.idx == null ? null : (u.data[0][u.cursor.idx] ?? null)),
      ],
      setSelect: [
        (u) => {
          const { left, width } = u.select;
          if (width < 4) return;
          host.cut(u.posToVal(left, 'x'), u.posToVal(left + width, 'x'));
          u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        },
      ],
    },
  };
  return new uPlot(options, columns as uPlot.AlignedData, element);
}

/** Returns the options of a scale of values: 3 is uPlot's logarithm. */
function distribution({ scale }: Style): Partial<uPlot.Scale> {
  return scale === 'log' ? { distr: 3, log: 10 } : {};
}

function cursorPoint(stroke: string): HTMLElement {
  const point = document.createElement('div');
  point.className = 'cursor-point';
  point.style.borderColor = stroke;
  return point;
}
