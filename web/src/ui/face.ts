/** Appearance of a state. */

/** Shapes, each with a single meaning, so that a state is recognised without its colour. */
export type Shape =
  | 'octagon'
  | 'diamond'
  | 'triangle'
  | 'ring-broken'
  | 'square-plus'
  | 'split'
  | 'cross'
  | 'bolt'
  | 'clock'
  | 'pause'
  | 'arrow'
  | 'back'
  | 'half'
  | 'check'
  | 'ring'
  | 'ring-dot'
  | 'twins'
  | 'signpost'
  | 'square-cross'
  | 'square-dash'
  | 'not-equal'
  | 'clock-off'
  | 'unlinked'
  | 'full'
  | 'dash'
  | 'signal';
/** Tone of a mark; `ink` stands out without asking for a person: a size beyond a tolerance. */
export type Tone = 'bad' | 'warn' | 'active' | 'good' | 'ink' | 'quiet';

export interface Face {
  word: string;
  shape: Shape;
  tone: Tone;
  /** Meaning of the state, in a sentence. */
  meaning: string;
}

/** Returns a face, also for a state of a newer service that this page does not know. */
export function faceOf(faces: Record<string, Face>, state: string): Face {
  return Object.hasOwn(faces, state) && faces[state] ? faces[state] : unknownFace(state);
}

function unknownFace(state: string): Face {
  return {
    word: state.replaceAll('_', ' '),
    shape: 'diamond',
    tone: 'warn',
    meaning: 'This page is older than the service: reload it.',
  };
}
