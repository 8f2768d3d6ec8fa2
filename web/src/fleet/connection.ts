/** Connection of a robot, apart from the standing of its calibration. */

import type { Robot } from '../api/types';
import type { Face, Tone } from '../ui/face';
import { formatSaid, formatTime } from '../units/format';

/** Connection of a robot, as displayed. */
export type Connection = 'online' | 'silent' | 'maintenance';

type Heard = Pick<Robot, 'stale' | 'state' | 'connection'>;

export const CONNECTIONS: Record<Connection, Face> = {
  online: {
    word: 'Online',
    shape: 'signal',
    tone: 'quiet',
    meaning: 'The robot sends data.',
  },
  silent: {
    word: 'Silent',
    shape: 'ring-broken',
    tone: 'warn',
    meaning: 'The robot sends nothing. Its values are the last known.',
  },
  maintenance: {
    word: 'In maintenance',
    shape: 'dash',
    tone: 'quiet',
    meaning: 'The robot is in maintenance and raises no alert for sending nothing.',
  },
};

/** Words for the connection of a robot in maintenance. */
const CONNECTED: Record<Connection, string> = {
  online: 'The robot sends data.',
  silent: 'The robot sends nothing.',
  maintenance: 'The robot sends nothing, and raises no alert for that.',
};

/** Returns the maintenance that a robot is in at `now_ms`. */
export function maintenanceOf({ connection }: Heard, now_ms: number) {
  const { maintenance } = connection;
  return maintenance && Date.parse(maintenance.until) > now_ms ? maintenance : undefined;
}

/** Returns the connection of a robot at `now_ms`. */
export function connectionOf(robot: Heard, now_ms: number): Connection {
  if (!robot.stale && robot.state !== 'no_data') return 'online';
  return maintenanceOf(robot, now_ms) ? 'maintenance' : 'silent';
}

/**
 * Returns the face of a robot's connection: with its maintenance, also while it drives, and for a
 * silent robot whether it is still connected.
 */
export function connectionFace(robot: Heard & Pick<Robot, 'alive'>, now_ms: number): Face {
  const connection = connectionOf(robot, now_ms);
  const face = CONNECTIONS[connection];
  const maintenance = maintenanceOf(robot, now_ms);
  if (maintenance) {
    const until = formatTime(Date.parse(maintenance.until));
    const why = `In maintenance until ${until}, says ${maintenance.by}: ${maintenance.reason}.`;
    const word = connection === 'online' ? `${face.word}, in maintenance` : face.word;
    return { ...face, word, meaning: `${CONNECTED[connection]} ${why}` };
  }
  if (connection !== 'silent' || !robot.alive) return face;
  return { ...face, meaning: 'The robot is connected, but sends no data.' };
}

/** Returns the end, reason and author of a robot's maintenance; empty outside one. */
export function maintenanceText(robot: Heard, now_ms: number): string {
  const maintenance = maintenanceOf(robot, now_ms);
  if (!maintenance) return '';
  const until = formatSaid(Date.parse(maintenance.until), now_ms);
  return `In maintenance until ${until}: ${maintenance.reason} (${maintenance.by})`;
}

/** Returns what is to be known or done about a robot that is silent or in maintenance. */
export function awayText(robot: Heard, now_ms: number): string {
  const maintained = maintenanceText(robot, now_ms);
  if (maintained !== '') return maintained;
  const silent = connectionOf(robot, now_ms) === 'silent';
  return silent ? 'Check that the robot is on and connected' : '';
}

const LAST_KNOWN: Record<Exclude<Connection, 'online'>, string> = {
  silent: 'Last known, the robot is silent',
  maintenance: 'Last known, the robot is in maintenance',
};

/**
 * Returns the tone of a robot's values: for a silent robot never a healthy one or one in progress,
 * since its present state is unknown.
 */
export function toneOf(tone: Tone, connection: Connection): Tone {
  return connection === 'online' || tone === 'bad' || tone === 'warn' ? tone : 'quiet';
}

/** Returns the displayed state of a robot; for a silent one it is the last known. */
export function lastKnown(face: Face, connection: Connection): Face {
  if (connection === 'online' || face.tone === 'bad' || face.tone === 'warn') return face;
  return {
    ...face,
    tone: toneOf(face.tone, connection),
    meaning: `${LAST_KNOWN[connection]}: ${face.meaning}`,
  };
}
