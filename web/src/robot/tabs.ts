/** The parts of a robot's page. The address says which one is shown. */

export const TABS = [
  ['overview', 'Overview'],
  ['evidence', 'Evidence'],
  ['history', 'History'],
  ['raw', 'Raw'],
] as const;

export type Tab = (typeof TABS)[number][0];

/** What an address of the charts says of time or scale. */
const OF_CHARTS = ['range', 'from', 'to', 'scale'];

/** The part in an address; one that names a time is about the history. */
export function tabOf(query: URLSearchParams): Tab {
  const named = TABS.find(([tab]) => tab === query.get('show'))?.[0];
  return named ?? (OF_CHARTS.some((key) => query.has(key)) ? 'history' : 'overview');
}
