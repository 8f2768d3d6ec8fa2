/** Descriptions of the events that programs can be notified of. */

import type { WebhookEvent } from '../api/types';

export const EVENTS: Record<WebhookEvent, string> = {
  'alert.alerting': 'alerts that begin to fire',
  'alert.resolved': 'alerts that are over',
  'proposal.waiting': 'proposals that wait',
  'rollout.halted': 'roll-outs that halt',
};
