import { describe, expect, it } from 'vitest';
import { encode } from 'uqr';
import { isLocal } from './label';
import { qrCode } from './qr';

describe('the QR code', () => {
  it('draws every dark square and no light one', () => {
    const text = 'https://fleet.example/robots/tugger_01/guide';
    const { size, path } = qrCode(text);
    const { data } = encode(text, { ecc: 'M', border: 4 });
    const dark = Array.from({ length: size }, () => Array<boolean>(size).fill(false));
    for (const [, x, y, length] of path.matchAll(/M(\d+) (\d+)h(\d+)v1H\1z/g)) {
      for (let i = 0; i < Number(length); i++) (dark[Number(y)] ?? [])[Number(x) + i] = true;
    }
    expect(dark).toEqual(data);
    expect(size).toBe(data.length);
  });

  it('says which addresses no phone can open', () => {
    expect(['localhost', '127.0.0.1', '[::1]'].every(isLocal)).toBe(true);
    expect(['fleet.example', '10.0.0.7', '127.example'].some(isLocal)).toBe(false);
  });
});
