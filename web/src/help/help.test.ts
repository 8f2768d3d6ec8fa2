import { describe, expect, it } from 'vitest';
import glossary from '../../../docs/glossary.md?raw';
import openapi from '../../openapi.json';
import { version } from '../../package.json';
import { termsOf } from './glossary';

describe('the help page', () => {
  it('has every term of the glossary, as plain text', () => {
    const terms = termsOf(glossary);
    const rows = glossary.split('\n').filter((line) => line.startsWith('| '));
    // Without the heading of the table.
    expect(terms).toHaveLength(rows.length - 1);
    expect(terms[0]).toEqual({
      term: 'acknowledge',
      meaning: 'to say that one looks after an alert',
    });
    for (const { term, meaning } of terms) expect(term + meaning).not.toMatch(/[`*|[\]]/);
  });

  it('names the version of the service that it comes with', () => {
    expect(version).toBe(openapi.info.version);
  });
});
