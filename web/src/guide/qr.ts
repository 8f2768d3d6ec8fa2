/** QR code of an address, as a path of squares. */

import { encode } from 'uqr';

/** Light squares around the code that scanners need. */
const BORDER = 4;

export interface Code {
  /** Squares along a side, the border included. */
  size: number;
  /** Dark squares, as a path of an SVG drawing with one unit for a square. */
  path: string;
}

/** Returns the QR code of a text, readable with up to 15 % of it soiled. */
export function qrCode(text: string): Code {
  const { data, size } = encode(text, { ecc: 'M', border: BORDER });
  const runs = data.flatMap((row, y) =>
    row.flatMap((dark, x) =>
      dark && !row[x - 1] ? [`M${x} ${y}h${runFrom(row, x)}v1H${x}z`] : [],
    ),
  );
  return { size, path: runs.join('') };
}

/** Returns the number of dark squares from one on. */
function runFrom(row: readonly boolean[], from: number): number {
  const end = row.indexOf(false, from);
  return (end < 0 ? row.length : end) - from;
}
