import { describe, expect, it } from 'vitest';
import type { Parameter, Robot, Standing } from '../api/types';
import { nextStep, type Reader } from './next';
import { BY_URGENCY, needsPerson } from './standing';

const approver: Reader = { operator: true, approver: true, approved: false };
const viewer: Reader = { operator: false, approver: false, approved: false };

function robot(proposal: number | null = null, need: string | null = null): Robot {
  const parameter = { value: 0, sigma: 1, unit: 'rad', status: 'converged', needs: need };
  const one = parameter as Parameter;
  return {
    id: 'tugger_01',
    state: 'calibrated',
    calibration: { proposal, deployment: null },
    estimate: {
      parameters: { steering_offset: one, lidar_x: one, lidar_y: one, lidar_yaw: one },
    },
  } as Robot;
}
const text = (standing: Standing, reader: Reader, given = robot(), progress = '') =>
  nextStep(given, standing, reader, progress)?.text;

describe('the next step', () => {
  it('is never nothing where a robot asks for attention', () => {
    for (const standing of BY_URGENCY.filter(needsPerson)) {
      for (const reader of [approver, viewer])
        expect(text(standing, reader), standing).toBeTruthy();
    }
    expect(text('verification_failed', approver)).toMatch(/roll back/);
    // After a rejection nothing is proposed any more, and the robot is still off.
    expect(text('uncalibrated', approver)).toBe('Propose current estimate');
    expect(text('drift', viewer)).toBe('Awaiting a proposal');
  });

  it('is nothing for a calibrated robot', () => {
    expect(nextStep(robot(), 'calibrated', approver, '')).toBeNull();
  });

  it('asks nobody to decide who cannot', () => {
    expect(nextStep(robot(7), 'awaiting_approval', approver, '')).toMatchObject({
      text: 'Review proposal',
      href: '/approvals/7',
    });
    const operator = { ...viewer, operator: true };
    expect(text('awaiting_approval', operator, robot(7))).toBe('Awaiting approval');
    expect(text('awaiting_approval', viewer, robot(7))).toBe('Awaiting approval');
    expect(text('awaiting_approval', { ...approver, approved: true }, robot(7))).toMatch(/second/);
  });

  it('is about a robot that is away, unless a person has to decide', () => {
    const away = 'Check that the robot is on and connected';
    const of = (standing: Standing, given: Robot) =>
      nextStep(given, standing, viewer, 'Verifying', away)?.text;
    expect(of('learning', robot(null, 'drive a left turn'))).toBe(away);
    expect(of('calibrated', robot())).toBe(away);
    expect(of('awaiting_approval', robot(7))).toBe('Awaiting approval');
    expect(of('fault', robot())).toBe('Check the sensor');
  });

  it('is the progress of what is under way, then the motion that is needed', () => {
    expect(text('deploying', approver, robot(), 'Verifying, 37 of 60 m')).toBe(
      'Verifying, 37 of 60 m',
    );
    expect(text('learning', viewer, robot(null, 'drive a left turn'))).toBe('drive a left turn');
  });
});
