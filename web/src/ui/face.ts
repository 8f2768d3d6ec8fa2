/** What a state looks like. */

/** A shape is never used for two meanings, so that a state is told without its colour. */
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
  | 'dash'
  | 'signal';
/** `ink` stands out and asks for nobody: a size beyond a tolerance. */
export type Tone = 'bad' | 'warn' | 'active' | 'good' | 'ink' | 'quiet';

export interface Face {
  word: string;
  shape: Shape;
  tone: Tone;
  /** What the state means, in a sentence. */
  meaning: string;
}

/** A face, also of a state that a newer service has and this page does not. */
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
