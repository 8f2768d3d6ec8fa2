/** Checks a person's entries about a vehicle before they are sent. The service checks again. */

const WHEELBASE_MAX_M = 30;

export type Checked = { ok: true; metres: number } | { ok: false; problem: string };

/** Parses a wheelbase in metres; accepts a decimal comma. */
export function wheelbase(typed: string): Checked {
  const text = typed.trim().replace(/\s*m$/, '').replace(',', '.');
  if (text === '') return { ok: false, problem: 'Type the wheelbase in metres, such as 1.200.' };
  if (!/^\d*\.?\d+$/.test(text)) {
    return { ok: false, problem: `"${typed.trim()}" is not a number of metres, such as 1.200.` };
  }
  const metres = Number(text);
  if (!(metres > 0 && metres <= WHEELBASE_MAX_M)) {
    const problem = `${text} m cannot be: more than 0 and at most ${WHEELBASE_MAX_M} m.`;
    return { ok: false, problem };
  }
  return { ok: true, metres };
}
