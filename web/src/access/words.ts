/** Descriptions of the rights of each role. */

import type { Role } from '../api/types';

export const ROLE_WORDS: Record<Role, string> = {
  robot: 'one robot, which pulls its own calibration',
  viewer: 'you read everything and change nothing',
  operator: 'you read, register robots, attach notes and propose',
  approver: 'you also approve what somebody else has proposed',
  admin: 'you also manage users and tokens',
};
