/** Parts of a robot's page, of which the address names one. */

export const TABS = [
  ['overview', 'Overview'],
  ['evidence', 'Evidence'],
  ['history', 'History'],
  ['raw', 'Raw'],
] as const;

export type Tab = (typeof TABS)[number][0];

/** Query parameters of the charts. */
const OF_CHARTS = ['range', 'from', 'to', 'scale', 'with'];

/** Returns the part that an address names; one with a time is about the history. */
export function tabOf(query: URLSearchParams): Tab {
  const named = TABS.find(([tab]) => tab === query.get('show'))?.[0];
  return named ?? (OF_CHARTS.some((key) => query.has(key)) ? 'history' : 'overview');
}
