/** Filter of the audit, in the page's address and in the API's query. */

/** Parameters that the page and the API name alike. */
const PLAIN = ['robot', 'actor', 'action'] as const;
/** Times: local in the address, in the format of their fields. */
const TIMES = ['from', 'to'] as const;

/** Converts the page's query to that of the API; omits empty parameters and invalid times. */
export function queryOf(page: URLSearchParams): string {
  const query = new URLSearchParams();
  for (const name of PLAIN) {
    const value = page.get(name)?.trim();
    if (value) query.set(name, value);
  }
  for (const name of TIMES) {
    const time_ms = Date.parse(page.get(name) ?? '');
    if (Number.isFinite(time_ms)) query.set(name, new Date(time_ms).toISOString());
  }
  return query.toString();
}

/**
 * Returns the differences of a record before and after: top-level fields, one line of text each.
 */
export function differences(
  before: unknown,
  after: unknown,
): { field: string; from: string; to: string }[] {
  const old = record(before);
  const young = record(after);
  const fields = [...new Set([...Object.keys(old), ...Object.keys(young)])];
  return fields.flatMap((field) => {
    const from = text(old[field]);
    const to = text(young[field]);
    return from === to ? [] : [{ field, from, to }];
  });
}

function record(value: unknown): Record<string, unknown> {
  return typeof value === 'object' && value !== null ? (value as Record<string, unknown>) : {};
}

function text(value: unknown): string {
  if (value === undefined || value === null) return '';
  return typeof value === 'string' ? value : JSON.stringify(value);
}
