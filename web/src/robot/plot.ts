/** Drawing of one parameter over time: sizes, colours and marks; the data come as columns. */

import uPlot from 'uplot';
import { colour } from '../ui/theme.svelte';
import { AXIS_FONT, PADDING, timeLabels, valueLabels } from './axes';
import { type Columns, isolated, lonePlace } from './series';

const AXIS_WIDTH = 58;
const MARK_SIZE = 4.5;
const POINT_SIZE = 3.5;

/** A mark of an event. */
export interface EventMark {
  t_s: number;
  tone: 'bad' | 'warn' | 'quiet';
}

/** Lines beside the estimate, in shown units. */
export interface Levels {
  /** Applied values, as steps in time. */
  applied: readonly { t_s: number; value: number | null }[];
  /** Proposed value; null without one. */
  proposed: number | null;
}

/** Interface from a chart to its page. */
export interface PlotHost {
  /** Duration that a point represents, s. */
  bucket_s(): number;
  /** Lowest and highest value now. */
  values(): [number, number];
  marks(): readonly EventMark[];
  levels(): Levels;
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

/** Draws the applied values as a step line, and the proposed one as a dashed line. */
function drawLevels(plot: uPlot, { applied, proposed }: Levels, colours: LevelColours): void {
  const { ctx, bbox } = plot;
  const right = bbox.left + bbox.width;
  clip(plot);
  ctx.lineWidth = 1.5 * devicePixelRatio;
  ctx.strokeStyle = colours.applied;
  ctx.beginPath();
  let drawing = false;
  applied.forEach(({ t_s, value }, i) => {
    if (value === null) {
      drawing = false;
      return;
    }
    const from = Math.max(bbox.left, plot.valToPos(t_s, 'x', true));
    const next = applied[i + 1];
    const to = next ? Math.min(right, plot.valToPos(next.t_s, 'x', true)) : right;
    const y = plot.valToPos(value, 'y', true);
    if (drawing) ctx.lineTo(from, y);
    else ctx.moveTo(from, y);
    ctx.lineTo(to, y);
    drawing = true;
  });
  ctx.stroke();
  if (proposed !== null) {
    const y = plot.valToPos(proposed, 'y', true);
    ctx.strokeStyle = colours.proposed;
    ctx.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(right, y);
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
  } else if (tone === 'warn') {
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
): uPlot {
  const accent = colour('--accent');
  const colours = { bad: colour('--bad'), warn: colour('--warn'), quiet: colour('--ink-faint') };
  const levelColours = { applied: colour('--ink'), proposed: colour('--accent') };
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
    scales: { x: { time: true }, y: { range: () => host.values() } },
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
        values: (_, splits, __, ___, step) => valueLabels(splits, step),
      },
    ],
    series: [
      {},
      { ...hidden },
      { ...hidden },
      { ...hidden },
      { ...hidden },
      { stroke: accent, width: 1.75, points: { show: false } },
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
      draw: [
        (u) => drawIsolated(u, host.bucket_s(), accent),
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

function cursorPoint(stroke: string): HTMLElement {
  const point = document.createElement('div');
  point.className = 'cursor-point';
  point.style.borderColor = stroke;
  return point;
}
