/** Wheel, fingers and double clicks over a chart, as new stretches of time. */

import type { Action } from 'svelte/action';
import { pinched, shifted, type Span, STEP, zoomed } from './zoom';

/** Chart under the gestures. */
export interface Gestured {
  /** Returns the stretch that is displayed. */
  span(): Span;
  /** Returns the last time that there may be data for. */
  end_s(): number;
  /** Displays a stretch while the gesture goes on. */
  show(span: Span): void;
  /** Stays with the stretch displayed last. */
  settle(): void;
  /** Shows all again; absent if nothing is selected. */
  all: (() => void) | undefined;
}

/** Pause after which the wheel has come to rest. */
const REST_MS = 250;
/** Change of the stretch by one step of a wheel: 100 px. */
const PER_PX = 0.002;
const PX_PER_LINE = 16;
/** Way of a finger from which it moves the chart. */
const MOVED_PX = 8;

/** The plot's own area, without its axes. */
function area(node: HTMLElement): DOMRect {
  return (node.querySelector('.u-over') ?? node).getBoundingClientRect();
}

/**
 * Follows the gestures over a chart. The wheel zooms where the chart has the focus, or with Ctrl as a
 * touch pad sends it: otherwise it scrolls the page.
 */
export const gestures: Action<HTMLElement, Gestured> = (node, given) => {
  let chart = given;
  let resting: ReturnType<typeof setTimeout> | undefined;
  const fingers = new Map<number, number>();
  /** Stretch and places of the fingers when the last one came or went. */
  let began: { span: Span; at: readonly number[] } | undefined;
  let hasMoved = false;

  const place = (clientX: number) => {
    const { left, width } = area(node);
    return (clientX - left) / Math.max(width, 1);
  };
  const timeAt = (clientX: number) => {
    const [from_s, to_s] = chart.span();
    return from_s + place(clientX) * (to_s - from_s);
  };

  function onwheel(event: WheelEvent): void {
    const isMeant = event.ctrlKey || event.metaKey || node.contains(document.activeElement);
    if (!isMeant) return;
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? PX_PER_LINE : 1;
    const [from_s, to_s] = chart.span();
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      const by_s = ((event.deltaX * lines) / area(node).width) * (to_s - from_s);
      chart.show(shifted([from_s, to_s], by_s, chart.end_s()));
    } else {
      const factor = Math.exp(event.deltaY * lines * PER_PX);
      chart.show(zoomed([from_s, to_s], timeAt(event.clientX), factor, chart.end_s()));
    }
    clearTimeout(resting);
    resting = setTimeout(() => chart.settle(), REST_MS);
  }

  function begin(): void {
    began = { span: chart.span(), at: [...fingers.values()] };
  }

  function onpointerdown(event: PointerEvent): void {
    node.focus({ preventScroll: true });
    if (event.pointerType !== 'touch' || fingers.size === 2) return;
    fingers.set(event.pointerId, place(event.clientX));
    hasMoved = hasMoved && fingers.size > 1;
    begin();
  }

  function onpointermove(event: PointerEvent): void {
    if (!began || !fingers.has(event.pointerId)) return;
    fingers.set(event.pointerId, place(event.clientX));
    const [a = 0, b] = began.at;
    const [a_now = 0, b_now] = [...fingers.values()];
    hasMoved ||= b !== undefined || Math.abs(a_now - a) * area(node).width > MOVED_PX;
    if (!hasMoved) return;
    const length_s = began.span[1] - began.span[0];
    chart.show(
      b === undefined || b_now === undefined
        ? shifted(began.span, (a - a_now) * length_s, chart.end_s())
        : pinched(began.span, [a, b], [a_now, b_now], chart.end_s()),
    );
  }

  function onpointerend(event: PointerEvent): void {
    if (!fingers.delete(event.pointerId)) return;
    if (fingers.size > 0) begin();
    else {
      began = undefined;
      if (hasMoved) chart.settle();
      hasMoved = false;
    }
  }

  function ondblclick(event: MouseEvent): void {
    if (chart.all) {
      chart.all();
      return;
    }
    chart.show(zoomed(chart.span(), timeAt(event.clientX), 1 / STEP, chart.end_s()));
    chart.settle();
  }

  const listeners = new AbortController();
  const { signal } = listeners;
  node.addEventListener('wheel', onwheel, { passive: false, signal });
  node.addEventListener('pointerdown', onpointerdown, { signal });
  node.addEventListener('pointermove', onpointermove, { signal });
  node.addEventListener('pointerup', onpointerend, { signal });
  node.addEventListener('pointercancel', onpointerend, { signal });
  node.addEventListener('dblclick', ondblclick, { signal });
  return {
    update: (next) => (chart = next),
    destroy: () => {
      clearTimeout(resting);
      listeners.abort();
    },
  };
};
