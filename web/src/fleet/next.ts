/** The next step for a robot, and the person responsible for it. */

import type { Robot, Standing } from '../api/types';
import { proposalPath, robotPath } from '../routes.svelte';
import { SHOWN } from '../units/parameters';
import { needs } from './list';
import { needsPerson } from './standing';

/** Reader of the page. */
export interface Reader {
  operator: boolean;
  approver: boolean;
  /** True if the open proposal needs somebody else: the reader made it or has approved it. */
  approved: boolean;
}

/** A step, with the address of its page if it has one for the reader. */
export interface Next {
  text: string;
  href: string | null;
  /** Full text, if `text` is shorter. */
  title: string;
}

/** Motion required by parameters that still need it: a task of an operator or driver. */
const ASKED: Partial<Record<Standing, string>> = {
  rollback_failed: 'Stop the robot and check it',
  verification_failed: 'Check the mount, then roll back or propose again',
  estimator_failed: 'Check why the estimator stopped',
  not_applied: 'Check why the robot did not apply it',
  out_of_sync: "Check the robot's agent",
  fault: 'Check the sensor',
};

/**
 * Returns the next step for `robot`, or null. A robot that needs a person always has one. `away` says
 * what is to be known or done about a robot that is silent or in maintenance; it comes before motions
 * that the robot should drive, and after what a person has to decide.
 */
export function nextStep(
  robot: Robot,
  standing: Standing,
  reader: Reader,
  progress: string,
  away = '',
): Next | null {
  const step = (text: string, href: string | null = null, title = text): Next => ({
    text,
    href,
    title,
  });
  const page = reader.operator ? robotPath(robot.id) : null;
  const { proposal } = robot.calibration;
  if (standing === 'rollback_failed') return step(ASKED.rollback_failed ?? '', page);
  if (robot.state === 'unregistered') {
    return page ? step('Set up vehicle', page) : step('Awaiting setup');
  }
  if (proposal != null) {
    const path = proposalPath(proposal);
    if (!reader.approver) return step('Awaiting approval', path);
    return step(reader.approved ? 'Awaiting a second approval' : 'Review proposal', path);
  }
  const asked = ASKED[standing];
  if (asked) return step(asked, page);
  if (away !== '') return step(away);
  if (progress !== '') return step(progress);
  const wanted = needs(robot);
  if (wanted.length > 0) {
    const all = wanted.map(
      ({ need, parameters }) => `${parameters.map((p) => SHOWN[p].label).join(', ')}: ${need}`,
    );
    return step(wanted.map(({ need }) => need).join('; '), null, all.join('\n'));
  }
  if (!robot.estimate) return step('Waiting for data');
  if (standing === 'drift' || standing === 'uncalibrated') {
    return page ? step('Propose current estimate', page) : step('Awaiting a proposal');
  }
  return needsPerson(standing) ? step('Check the robot', page) : null;
}
