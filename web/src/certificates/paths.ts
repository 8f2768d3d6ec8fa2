/** Addresses of certificates, which the browser follows itself. */

const ALL = '/api/v1/certificates';

/** Returns the address of the page that prints. */
export function certificatePage(number: number): string {
  return `${ALL}/${number}?format=html`;
}

/** Returns the address of the signed file. */
export function certificateFile(number: number): string {
  return `${ALL}/${number}`;
}

/** Returns the address of the file of all certificates, or of those of one robot. */
export function certificatesFile(robot: string | null): string {
  const query = new URLSearchParams({ format: 'ndjson' });
  if (robot) query.set('robot', robot);
  return `${ALL}?${query}`;
}
