/** Progress of a decision: approved, sent, applied, verified by driving. */

import type { Deployment, DeploymentState, Robot } from '../api/types';
import { DEPLOYMENTS } from './words';

/** State of one step. */
export type StepState = 'done' | 'now' | 'ahead' | 'failed';

export interface Step {
  word: string;
  state: StepState;
  /** Time at which it was done. */
  at: string | null;
}

/** Progress of the verification: metres driven, and metres needed. */
export interface Driven {
  driven_m: number | null;
  needed_m: number | null;
}

/**
 * Number of completed steps in each state; the remaining step of an ended deployment is its end.
 */
const DONE: Record<DeploymentState, number> = {
  queued: 1,
  offered: 2,
  applied: 3,
  verifying: 3,
  verified: 4,
  inconclusive: 3,
  refused: 2,
  failed: 2,
  timed_out: 2,
  withdrawn: 1,
  rolling_back: 3,
  rolled_back: 3,
  rollback_failed: 3,
  kept: 3,
};
const UNDER_WAY: readonly DeploymentState[] = ['queued', 'offered', 'applied', 'verifying'];

/** `Verifying, 37 of 60 m`: progress of the verification, as far as it is known. */
export function verifying({ driven_m, needed_m }: Driven): string {
  if (driven_m === null || needed_m === null) return 'Verifying';
  const driven = Math.min(Math.floor(driven_m), Math.floor(needed_m));
  return driven < needed_m
    ? `Verifying, ${driven} of ${needed_m.toFixed(0)} m`
    : `Verifying, ${driven_m.toFixed(0)} m driven, not yet certain`;
}

/** Returns the steps of a deployment, in order. */
export function stepsOf(deployment: Deployment, driven: Driven): Step[] {
  const { state, proposal, created, offered, applied, closed, verification } = deployment;
  const done = DONE[state] ?? 1;
  const words = [
    proposal == null ? 'Requested' : 'Approved',
    done > 1 ? 'Sent' : 'Send',
    done > 2 ? 'Applied' : 'Apply',
    state === 'verified'
      ? `Verified${verification ? ` over ${verification.distance_m.toFixed(0)} m` : ''}`
      : state === 'verifying' || state === 'applied'
        ? verifying(driven)
        : 'Verify',
  ];
  const times = [created, offered, applied, closed];
  const steps = words.map((word, i): Step => {
    const how = i < done ? 'done' : i === done && UNDER_WAY.includes(state) ? 'now' : 'ahead';
    return { word, state: how, at: how === 'done' ? (times[i] ?? null) : null };
  });
  if (UNDER_WAY.includes(state) || state === 'verified') return steps;
  const end: Step = {
    word: DEPLOYMENTS[state]?.word ?? state,
    state: 'failed',
    at: closed ?? null,
  };
  if (state === 'rolling_back') end.state = 'now';
  return [...steps.slice(0, done), end];
}

/**
 * Returns the progress of a robot in a list, in a few words; empty while nothing is in progress.
 */
export function progressText(robot: Robot, needed_m: number | null): string {
  const { deployment } = robot.calibration;
  if (deployment === 'queued') return 'Queued for sending';
  if (deployment === 'offered') return 'Sent, not applied yet';
  if (deployment === 'rolling_back') return 'Rolling back';
  if (deployment !== 'applied' && deployment !== 'verifying') return '';
  return verifying({ driven_m: robot.verification_distance_m ?? null, needed_m });
}
