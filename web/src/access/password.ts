/** Checks a new password before it is sent. The service checks again. */

const CHARS_MIN = 12;
const CHARS_MAX = 128;

/** What is accepted, in words. */
export const ACCEPTED = `${CHARS_MIN} to ${CHARS_MAX} characters; no other rules.`;

/** What is wrong with a new password that was typed twice; empty when nothing is. */
export function passwordProblem(password: string, again: string): string {
  const chars = Array.from(password).length;
  if (chars < CHARS_MIN || chars > CHARS_MAX) {
    return `Use ${CHARS_MIN} to ${CHARS_MAX} characters (now ${chars}).`;
  }
  return password === again ? '' : 'The two passwords are not the same.';
}
