/** Which rows of a long table are in view. */

/** The height of every row, its line included. */
export const ROW_HEIGHT_PX = 51;
/** Rows that are there beyond the view's edges, for the next scroll and for the Tab key. */
const BEYOND = 8;
/** The view begins and ends at a multiple of this, so that a scrolled line changes nothing. */
const STEP = 4;

/** The first row in view, and the one after the last; `scrolled_px` is how far into the rows. */
export function rowsInView(
  rows: number,
  scrolled_px: number,
  height_px: number,
): { first: number; end: number } {
  const above = Math.floor(scrolled_px / ROW_HEIGHT_PX) - BEYOND;
  const below = Math.ceil((scrolled_px + height_px) / ROW_HEIGHT_PX) + BEYOND;
  const first = Math.max(0, Math.min(Math.floor(above / STEP) * STEP, rows - 2 * BEYOND));
  return { first, end: Math.min(rows, Math.max(Math.ceil(below / STEP) * STEP, 2 * BEYOND)) };
}
