/** Curve of a robot's steering as a drawing and as a file. */

import type { SteeringTable } from '../api/types';

const DEG = 180 / Math.PI;
/** Smallest half height of a drawing, °: smaller corrections do not fill it. */
const LEAST_DEG = 0.25;
/** Standard deviations of the band to either side. */
const BAND_SIGMAS = 2;

/** One point: the measured angle and the correction that makes it the true one, °. */
export interface Correction {
  measured_deg: number;
  correction_deg: number;
  sigma_deg: number;
}

/** Returns the points of a table in degrees, from the right to the left. */
export function correctionsOf({ points }: SteeringTable): Correction[] {
  return points.map(({ measured_rad, true_rad, sigma_rad }) => ({
    measured_deg: measured_rad * DEG,
    correction_deg: (true_rad - measured_rad) * DEG,
    sigma_deg: sigma_rad * DEG,
  }));
}

/** A curve in pixels, left steering on the left, and its scale. */
export interface Drawing {
  line: string;
  band: string;
  dots: readonly (readonly [number, number])[];
  /** Height of a correction of 0. */
  zero_y: number;
  /** Correction at the upper edge, °; at the lower edge it is the negative of this. */
  most_deg: number;
}

/** Draws corrections into a frame of `width` times `height`. */
export function draw(corrections: Correction[], width: number, height: number): Drawing {
  const ends = corrections.map(
    ({ correction_deg, sigma_deg }) => Math.abs(correction_deg) + BAND_SIGMAS * sigma_deg,
  );
  const most_deg = Math.max(LEAST_DEG, ...ends);
  const right_deg = corrections[0]?.measured_deg ?? 0;
  const left_deg = corrections.at(-1)?.measured_deg ?? 0;
  const across = Math.max(left_deg - right_deg, 1e-9);
  const x = (deg: number) => ((left_deg - deg) / across) * width;
  const y = (deg: number) => (0.5 - (0.5 * deg) / most_deg) * height;
  const path = (points: (readonly [number, number])[]) =>
    points.map(([px, py], i) => `${i === 0 ? 'M' : 'L'}${px.toFixed(1)} ${py.toFixed(1)}`).join('');
  const edge = (sigmas: number) =>
    corrections.map(
      ({ measured_deg, correction_deg, sigma_deg }) =>
        [x(measured_deg), y(correction_deg + sigmas * sigma_deg)] as const,
    );
  const dots = edge(0);
  const band = [...edge(BAND_SIGMAS), ...edge(-BAND_SIGMAS).reverse()];
  return { line: path(dots), band: `${path(band)}Z`, dots, zero_y: y(0), most_deg };
}

/** Returns a CSV file of a table: status, head and rows as the agent on the robot writes them. */
export function steeringCsv({ status, needs, points }: SteeringTable): string {
  // A comment is one line.
  const missing = needs ? ` Missing: ${needs.replace(/\p{Cc}/gu, ' ')}.` : '';
  const rows = points.map(({ measured_rad, true_rad, sigma_rad }) =>
    [measured_rad, true_rad, sigma_rad].map((rad) => rad.toFixed(8)).join(','),
  );
  const head = [`# Status: ${status}.${missing}`, 'measured_rad,true_rad,sigma_rad'];
  return [...head, ...rows, ''].join('\n');
}
