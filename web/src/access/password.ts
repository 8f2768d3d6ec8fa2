/** Checks a new password before it is sent. The service checks again. */

const CHARS_MIN = 12;
const CHARS_MAX = 128;

/** What is accepted, in words. */
export const ACCEPTED = `${CHARS_MIN} to ${CHARS_MAX} characters; nothing else is asked of them.`;

/** What is wrong with a new password that was typed twice; empty when nothing is. */
export function passwordProblem(password: string, again: string): string {
  const chars = Array.from(password).length;
  if (chars < CHARS_MIN || chars > CHARS_MAX) {
    return `The password has ${chars} characters, accepted are ${CHARS_MIN} to ${CHARS_MAX}.`;
  }
  return password === again ? '' : 'The two passwords are not the same.';
}
