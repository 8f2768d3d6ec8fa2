/** Roles that a person or a token can have. */

import type { Role } from '../api/types';

export const ROLES: readonly Role[] = ['viewer', 'operator', 'approver', 'admin'];
export const TOKEN_ROLES: readonly Role[] = [...ROLES, 'robot'];

/** Descriptions of the rights of each role. */
export const MAY: Record<Role, string> = {
  viewer: 'A viewer reads everything and changes nothing.',
  operator: 'An operator reads, registers robots, attaches notes, takes alerts on and proposes.',
  approver: 'An approver is an operator who also approves what somebody else has proposed.',
  admin: 'An administrator is an approver who also manages users, tokens and webhooks.',
  robot: 'A robot reads and acknowledges its own calibration, nothing else.',
};
