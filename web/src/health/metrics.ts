/** The service's own metrics, parsed from the Prometheus text format. */

export interface Sample {
  name: string;
  labels: Record<string, string>;
  value: number;
}

const LINE = /^([a-zA-Z_:][\w:]*)(?:\{(.*)\})? (\S+)/;
const LABEL = /(\w+)="((?:[^"\\]|\\.)*)"/g;

/** Parses the samples of the text exposition format; omits comments and unreadable lines. */
export function parseMetrics(text: string): Sample[] {
  return text.split('\n').flatMap((line) => {
    const [, name, given = '', number] = LINE.exec(line) ?? [];
    const value = Number(number);
    if (!name || number === undefined || Number.isNaN(value)) return [];
    const labels: Record<string, string> = {};
    for (const [, key, text] of given.matchAll(LABEL)) {
      if (key && text !== undefined) labels[key] = text.replaceAll(/\\(.)/g, '$1');
    }
    return [{ name, labels, value }];
  });
}

/** Sums the samples of a name that have these labels; null without samples. */
export function total(
  samples: readonly Sample[],
  name: string,
  labels: Record<string, string> = {},
): number | null {
  const wanted = Object.entries(labels);
  const found = samples.filter(
    (sample) => sample.name === name && wanted.every(([key, text]) => sample.labels[key] === text),
  );
  return found.length === 0 ? null : found.reduce((sum, { value }) => sum + value, 0);
}
