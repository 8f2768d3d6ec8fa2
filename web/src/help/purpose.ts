/** What fleetcal is for, in a sentence: sign-in, help and every footer say it. */
export const PURPOSE =
  'fleetcal finds each robot’s steering offset and LiDAR mount while it works, and says when to correct them.';
