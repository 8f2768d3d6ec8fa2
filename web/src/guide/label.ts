/** Address that a label for a robot's mast leads to. */

/** True for an address that only this machine can open. */
export function isLocal(host: string): boolean {
  return host === 'localhost' || host === '[::1]' || /^127(\.\d+){3}$/.test(host);
}
