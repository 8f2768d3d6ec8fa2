/** Alerts of selected robots that are to be acknowledged. */

import { fires } from '../alerts/alerts.svelte';
import type { ActionTarget, Alert } from '../api/types';

type Read = NonNullable<ActionTarget['alerts']>;

/**
 * Returns the firing alerts that nobody has acknowledged, by robot. One about several robots is
 * listed at the first that is selected.
 */
export function alertsOf(ids: readonly string[], alerts: readonly Alert[]): Map<string, Read> {
  const selected = new Set(ids);
  const found = new Map<string, Read>();
  for (const alert of alerts) {
    if (alert.acknowledgement || !fires(alert)) continue;
    const about = alert.robot == null ? alert.robots : [alert.robot];
    const robot = about.find((id) => selected.has(id));
    if (robot === undefined) continue;
    const { id, version } = alert;
    found.set(robot, [...(found.get(robot) ?? []), { id, version }]);
  }
  return found;
}
