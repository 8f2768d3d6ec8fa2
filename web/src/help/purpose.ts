/** Purpose of fleetcal in a sentence, for sign-in, help and every footer. */
export const PURPOSE =
  'fleetcal finds each robot’s steering offset and LiDAR mount while it works, and says when to correct them.';
