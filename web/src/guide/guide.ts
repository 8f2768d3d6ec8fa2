/**
 * Guided calibration after work on a robot: what stands now and what comes next, from the documents
 * of the service alone, so that every phone shows the same.
 */

import type { Manoeuvres, Robot, RobotDocument, Standing } from '../api/types';
import { type Connection, CONNECTIONS } from '../fleet/connection';
import { deviationOf } from '../fleet/deviation';
import { needs } from '../fleet/list';
import { STANDINGS } from '../fleet/standing';
import { telling } from '../robot/manoeuvres';
import { type Reassembly, VERDICTS } from '../robot/reassembly';
import type { Face } from '../ui/face';
import { CALIBRATED } from '../units/parameters';

export type Manoeuvre = Manoeuvres['items'][number];

/** Parts of a robot that a person works on, as the report names them. */
export const WORK = ['Bracket', 'LiDAR', 'Steering', 'Wheels', 'Other'] as const;
export type Work = (typeof WORK)[number];

/** Returns the note of a report; null while the part is not named. */
export function noteOf(work: Work | null, words: string): string | null {
  const more = words.trim();
  if (work === null || (work === 'Other' && more === '')) return null;
  if (work === 'Other') return more;
  return more === '' ? work : `${work}: ${more}`;
}

/** Time for which a verdict is the answer to a person who opens the page; an older one is history. */
const ANSWERS_FOR_MS = 3_600_000;

/**
 * Stage of the calibration: a question, driving, an obstacle, or the end.
 *
 * `ask`: nothing is open; `drive`: the robot has to drive; `blocked`: driving would tell nothing;
 * `same`, `changed`, `learned`: the service's verdict.
 */
export type Stage = 'ask' | 'drive' | 'blocked' | 'same' | 'changed' | 'learned';

/** Tasks of a person, by the state that stands in the way of calibration. */
const OBSTACLES: Partial<Record<Standing, string>> = {
  rollback_failed: 'Do not drive it. Stop the robot and check it.',
  two_senders: 'Find the second sender of this id and stop it.',
  former_key: 'Have the robot send its wheel odometry on the present key.',
  estimator_failed: 'Report it to the operator of the service.',
  no_instance: 'Report it to the operator of the service.',
  no_data: 'Check that the robot is on and connected.',
  fault:
    'Follow the joining check on the robot’s page; without one, check the sensor. Learning goes on by itself once the fault has gone.',
  unregistered: 'Set up the vehicle on the robot’s page.',
};

/** Obstacles that take nothing from a verdict that was given before them, nor refuse a report. */
const PASSING: readonly Standing[] = ['no_data', 'fault'];

/** State of the robot that calibration cannot get past. */
export interface Obstacle {
  standing: Standing;
  because: string;
  todo: string;
}

/** Returns what stands in the way of calibration, or null. */
export function obstacleOf(
  { robot, standing, warnings }: Seen,
  connection: Connection,
): Obstacle | null {
  const found = [...warnings.map(({ kind }) => kind), standing].find((one) =>
    Object.hasOwn(OBSTACLES, one),
  ) as Standing | undefined;
  const failed = robot.state === 'failed' ? 'estimator_failed' : undefined;
  const name = failed ?? found ?? (connection === 'online' ? undefined : 'no_data');
  return name === undefined ? null : obstacleBy(name);
}

/** Face of an obstacle: a robot that sends nothing is silent, whatever is known of it. */
function faceOfObstacle(standing: Standing): Face {
  return standing === 'no_data' ? CONNECTIONS.silent : STANDINGS[standing];
}

function obstacleBy(standing: Standing): Obstacle {
  return { standing, because: faceOfObstacle(standing).meaning, todo: OBSTACLES[standing] ?? '' };
}

/**
 * True if a joining check names a cause for which the service takes every value back. With a cause
 * that is unsure it goes on calibrating.
 */
function isSpoiled({ robot, warnings }: Seen): boolean {
  const isNamed = warnings.some(({ kind }) => kind === 'joining_check');
  const known = Object.values(robot.estimate?.parameters ?? {});
  return isNamed && known.every(({ status }) => status !== 'converged');
}

/** The robot as the service describes it. */
export interface Seen {
  robot: Robot;
  standing: Standing;
  warnings: RobotDocument['warnings'];
}

export interface Guide {
  stage: Stage;
  obstacle: Obstacle | null;
  /** Latest reassembly, also one whose verdict is history. */
  reassembly: Reassembly | null;
}

/** Returns the stage of a robot's calibration at `now_ms`. */
export function guideOf(
  seen: Seen,
  connection: Connection,
  reassembly: Reassembly | null,
  now_ms: number,
): Guide {
  const told = verdictOf(reassembly, now_ms);
  // A change after the verdict that nothing had changed.
  const given = told === 'same' && seen.robot.state === 'changed' ? 'changed' : told;
  const isTakenBack = given !== null && isSpoiled(seen);
  const obstacle = obstacleOf(seen, connection) ?? (isTakenBack ? obstacleBy('fault') : null);
  const isOpen = reassembly?.verdict === 'open' || seen.robot.estimate?.reassembly_open === true;
  // Work on a robot that is switched off can be reported.
  const passes =
    obstacle !== null && PASSING.includes(obstacle.standing) && !isOpen && !isTakenBack;
  const stage = obstacle && !passes ? 'blocked' : (given ?? (isOpen ? 'drive' : 'ask'));
  return { stage, obstacle, reassembly };
}

/** Returns the stage that the service's verdict is, while it answers who opens the page. */
function verdictOf(reassembly: Reassembly | null, now_ms: number): Stage | null {
  if (!reassembly?.by) return null;
  if (now_ms - Date.parse(reassembly.by.received) > ANSWERS_FOR_MS) return null;
  if (reassembly.verdict === 'same' || reassembly.verdict === 'changed') return reassembly.verdict;
  return reassembly.verdict === 'nothing_stored' ? 'learned' : null;
}

/**
 * Motion that is asked for next, in the words of the service, and the manoeuvre to draw for it; null
 * where no single one is meant.
 */
export interface Asked {
  text: string;
  manoeuvre: Manoeuvre | null;
}

/** Returns the motion that is missing, the best first; null while none is. */
export function askedOf(robot: Robot, ranked: readonly Manoeuvre[]): Asked | null {
  const wanted = needs(robot).map(({ need }) => need);
  const [first] = wanted;
  if (first === undefined) return null;
  const [best] = telling([...ranked], wanted);
  return best && wanted.includes(best.instruction)
    ? { text: best.instruction, manoeuvre: best }
    : { text: first, manoeuvre: null };
}

/**
 * True while there is something to drive: from a report to its verdict, and for a robot that still
 * has to learn something. One that is unchanged needs no more, whatever driving would tell.
 */
export function hasToDrive({ stage }: Guide, asked: Asked | null): boolean {
  if (stage === 'drive') return true;
  return stage !== 'same' && stage !== 'blocked' && asked !== null;
}

/** Returns how many of the four values are known, and how many are wanted. */
export function knownOf(robot: Robot): { known: number; of: number } {
  const wanted = CALIBRATED.map((name) => robot.estimate?.parameters[name].status).filter(
    (status) => status !== 'fixed' && status !== 'off',
  );
  return { known: wanted.filter((status) => status === 'converged').length, of: wanted.length };
}

/** Faces of the stages. */
export const STAGES: Record<Exclude<Stage, 'blocked'>, Face> = {
  ask: {
    word: 'Nothing reported',
    shape: 'ring',
    tone: 'quiet',
    meaning: 'Say below what was done: the comparison starts with your report.',
  },
  drive: {
    word: 'Not known yet',
    shape: 'half',
    tone: 'active',
    meaning: 'The robot has to drive until it is calibrated again.',
  },
  same: {
    word: 'Unchanged',
    shape: 'check',
    tone: 'good',
    meaning: 'It is calibrated as before the work.',
  },
  changed: {
    word: 'Changed',
    shape: 'diamond',
    tone: 'bad',
    meaning: 'It is no longer calibrated as before the work.',
  },
  learned: {
    word: 'Learned',
    shape: 'check',
    tone: 'good',
    meaning: 'No finished calibration was known before the work, so nothing was compared.',
  },
};

/** Returns the face of a stage. */
export function stageFace({ stage, obstacle, reassembly }: Guide): Face {
  if (stage === 'ask' && reassembly?.verdict === 'none') return VERDICTS.none;
  if (stage !== 'blocked') return STAGES[stage];
  const tone = obstacle ? faceOfObstacle(obstacle.standing).tone : 'bad';
  const because = obstacle?.because ?? '';
  return {
    word: 'Cannot be calibrated',
    shape: 'cross',
    tone: tone === 'warn' ? 'warn' : 'bad',
    meaning: because,
  };
}

/** Returns whether the robot may be driven for its calibration, in a few words. */
export function mayDrive({ stage, obstacle }: Guide, usesKnown: boolean): string {
  switch (stage) {
    case 'blocked':
      return obstacle?.standing === 'rollback_failed' ? 'No, stop it' : 'Not yet';
    case 'ask':
      return 'Report first';
    case 'drive':
      return 'Yes, by hand';
    case 'same':
      return 'Yes';
    default:
      return usesKnown ? 'Yes' : 'By hand only';
  }
}

/** Returns whether the driver is done, in a few words. */
export function isDone(
  guide: Guide,
  robot: Robot,
  asked: Asked | null,
  usesKnown: boolean,
): string {
  const { known, of } = knownOf(robot);
  if (guide.stage === 'ask') return 'Not started';
  if (guide.stage === 'blocked' || hasToDrive(guide, asked)) return `No, ${known} of ${of} known`;
  return guide.stage === 'same' || usesKnown ? 'Yes' : 'With driving, yes';
}

/**
 * True if the robot is known to use what is estimated now, by the tolerance of proposals: false also
 * for one that has not said what it uses.
 */
export function usesEstimate(robot: Robot): boolean {
  const { worst } = deviationOf(robot);
  return worst !== null && worst <= 1;
}
