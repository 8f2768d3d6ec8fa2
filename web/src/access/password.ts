/** Checks a new password before it is sent. The service checks again. */

const CHARS_MIN = 12;
const CHARS_MAX = 128;

/** Description of an accepted password. */
export const ACCEPTED = `${CHARS_MIN} to ${CHARS_MAX} characters; no other rules.`;

/** Returns the problem of a new password that was typed twice; empty if it is accepted. */
export function passwordProblem(password: string, again: string): string {
  const chars = Array.from(password).length;
  if (chars < CHARS_MIN || chars > CHARS_MAX) {
    return `Use ${CHARS_MIN} to ${CHARS_MAX} characters (now ${chars}).`;
  }
  return password === again ? '' : 'The two passwords are not the same.';
}
