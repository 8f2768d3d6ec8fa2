/** Words and shapes for the health of an instance of the service. */

import type { Cluster, Instance } from '../api/types';
import type { Face } from '../ui/face';
import { signed } from '../units/format';

/** Clock offset from the database's beyond which an alert is raised, s. */
const CLOCK_WARNED_BEYOND_S = 1;
/** Clock offset from the database's beyond which an instance releases its robots, s. */
const CLOCK_USED_UP_TO_S = 10;

const FACES = {
  ended: {
    word: 'Lease ended',
    shape: 'octagon',
    tone: 'bad',
    meaning: 'It has not renewed its lease: others take its robots over.',
  },
  unlinked: {
    word: 'No router',
    shape: 'ring-broken',
    tone: 'bad',
    meaning: 'It reaches no Zenoh router: no robot reaches it.',
  },
  clock: {
    word: 'Clock off',
    shape: 'ring-broken',
    tone: 'bad',
    meaning: 'Its clock is more than 10 s from the database’s: other instances take its robots.',
  },
  draining: {
    word: 'Draining',
    shape: 'arrow',
    tone: 'active',
    meaning: 'It is about to end and hands its robots over.',
  },
  serving: {
    word: 'Serving',
    shape: 'check',
    tone: 'good',
    meaning: 'It renews its lease and reaches a Zenoh router.',
  },
} satisfies Record<string, Face>;

/** Returns the face of an instance: its worst condition. */
export function instanceFace(
  instance: Pick<Instance, 'lease_left_s' | 'linked' | 'draining' | 'clock_ahead_s'>,
): Face {
  if (instance.lease_left_s <= 0) return FACES.ended;
  if (Math.abs(instance.clock_ahead_s) > CLOCK_USED_UP_TO_S) return FACES.clock;
  if (!instance.linked) return FACES.unlinked;
  return instance.draining ? FACES.draining : FACES.serving;
}

/** Returns the conditions of an instance that need a person, each in a few words. */
export function concerns(
  instance: Pick<Instance, 'clock_ahead_s' | 'config_differs' | 'unheard'>,
): string[] {
  return [
    ...(Math.abs(instance.clock_ahead_s) > CLOCK_WARNED_BEYOND_S ? ['clock off'] : []),
    ...(instance.config_differs ? ['configuration differs'] : []),
    ...(instance.unheard.length > 0 ? [`does not hear ${instance.unheard.join(', ')}`] : []),
  ];
}

/** Returns the offset of a clock ahead of the database's: `+0.012`, in seconds. */
export function clockAhead(instance: Pick<Instance, 'clock_ahead_s'>): string {
  return signed(instance.clock_ahead_s, 3);
}

/** Returns the cluster duties of an instance. */
export function dutiesOf(cluster: Pick<Cluster, 'duties'>, name: string): string {
  const own = cluster.duties.filter(({ instance }) => instance === name);
  return own.map(({ duty }) => duty).join(', ') || 'none';
}

/** Returns the duties that no instance has. */
export function vacant(cluster: Pick<Cluster, 'duties'>): string[] {
  return cluster.duties.filter(({ instance }) => instance == null).map(({ duty }) => duty);
}
