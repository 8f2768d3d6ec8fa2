/** What programs can be told of, in words. */

import type { WebhookEvent } from '../api/types';

export const EVENTS: Record<WebhookEvent, string> = {
  'alert.alerting': 'alerts that begin to fire',
  'alert.resolved': 'alerts that are over',
  'proposal.waiting': 'proposals that wait',
};
