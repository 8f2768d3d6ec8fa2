/** Visible rows of a long table. */

/** Height of every row, including its line. */
export const ROW_HEIGHT_PX = 51;
/** Number of rows rendered beyond the view's edges, for the next scroll and for the Tab key. */
const BEYOND = 8;
/** Granularity of the view's first and last row, so that scrolling by a line changes nothing. */
const STEP = 4;

/**
 * Returns the first visible row, and the one after the last; `scrolled_px` is the offset into the
 * rows.
 */
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
