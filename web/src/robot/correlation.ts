/** Correlations of a calibration's errors. */

/** Correlation from which two values are hardly known apart. */
export const STRONG = 0.9;

/** Returns the correlations of a covariance; null where a variance is zero. */
export function correlations(covariance: readonly (readonly number[])[]): (number | null)[][] {
  const sigma = covariance.map((row, i) => Math.sqrt(row[i] ?? Number.NaN));
  return covariance.map((row, i) =>
    row.map((entry, j) => {
      const of = entry / ((sigma[i] ?? Number.NaN) * (sigma[j] ?? Number.NaN));
      return Number.isFinite(of) ? Math.min(1, Math.max(-1, of)) : null;
    }),
  );
}
