import { accessible, expect, test } from './fixtures';

test.use({ command: 'serve', own: 'hostile' });

/** Texts for names and notes that a page must show as text and nothing more. */
const TRICKS = [
  '<script>alert(1)</script>',
  '<img src=x onerror=alert(1)>',
  '<svg/onload=alert(1)>',
  '<iframe src="javascript:alert(1)"></iframe>',
  '<a href="javascript:alert(1)">click</a>',
  '"><script>alert(1)</script>',
  "' onmouseover='alert(1)",
  '{{constructor.constructor("alert(1)")()}}',
  '${alert(1)}',
  '{@html "<b>x</b>"}',
  '<style>*{display:none}</style>',
  '<base href="http://evil.invalid/">',
  '<meta http-equiv=refresh content="0;url=http://evil.invalid">',
  '<form action="http://evil.invalid"><button>x</button></form>',
  '<link rel=stylesheet href="http://evil.invalid/x.css">',
  '<object data="http://evil.invalid/x">',
  '<video src="http://evil.invalid/x.mp4" autoplay>',
  '<details open ontoggle=alert(1)>',
  '<input autofocus onfocus=alert(1)>',
  '<math><mi xlink:href="javascript:alert(1)">x</mi></math>',
  'javascript:alert(1)',
  'data:text/html,<script>alert(1)</script>',
  '&lt;b&gt;not bold&lt;/b&gt;',
  '&#60;script&#62;',
  '</textarea><script>alert(1)</script>',
  '</title><script>alert(1)</script>',
  '<!--<img src="--><img src=x onerror=alert(1)//">',
  '<![CDATA[<script>alert(1)</script>]]>',
  "'; DROP TABLE robot; --",
  '" OR 1=1 --',
  '../../../etc/passwd',
  '%3Cscript%3Ealert(1)%3C/script%3E',
  '\\u003cscript\\u003ealert(1)',
  '=HYPERLINK("http://evil.invalid")',
  '+cmd|calc!A0',
  '\u202Egnp.exe',
  'z\u0351\u0321a\u0334\u0317l\u0489go',
  '\u200B\u200Bzero\u200Bwidth',
  '😀👩‍👩‍👧‍👦🏴‍☠️',
  'ﷺ ۝ مرحبا',
  '日本語の名前',
  'Ω≈ç√∫˜µ≤≥÷',
  'null',
  'undefined',
  'NaN',
  '__proto__',
  'constructor',
  'x'.repeat(900),
  'word '.repeat(180).trim(),
  '<x>'.repeat(300),
];
const ROBOT = 'tugger_01';

test('50 hostile names and notes are shown as text', async ({ page }) => {
  test.setTimeout(120_000);
  expect(TRICKS).toHaveLength(50);
  page.on('dialog', () => {
    throw new Error('a dialog was opened');
  });
  const { request } = page;
  const made = await request.put(`/api/v1/robots/${ROBOT}`, {
    headers: { 'if-none-match': '*' },
    data: { model: 'bicycle', wheelbase_m: 1.2 },
  });
  expect(made.status()).toBe(201);
  for (const [i, trick] of TRICKS.entries()) {
    const noted = await request.post(`/api/v1/robots/${ROBOT}/events`, {
      headers: { 'idempotency-key': `note-${i}` },
      data: { kind: 'maintenance', note: trick },
    });
    expect(noted.status(), trick).toBe(201);
    const token = await request.post('/api/v1/tokens', {
      headers: { 'idempotency-key': `token-${i}` },
      data: { name: trick.slice(0, 60), role: 'viewer' },
    });
    // Names may be refused; what is taken has to be shown.
    expect([201, 400, 422], trick).toContain(token.status());
  }

  await page.goto(`/robots/${ROBOT}?show=history`);
  const notes = page.getByRole('listitem').filter({ hasText: 'Maintenance' });
  await expect(notes).toHaveCount(TRICKS.length);
  const shown = await notes.locator('p').allTextContents();
  expect(shown.toSorted()).toEqual(TRICKS.toSorted());
  await nothingGrew();
  await accessible(page);
  await page.setViewportSize({ width: 390, height: 844 });
  const sideways = await page.evaluate(
    () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
  );
  expect(sideways).toBe(0);
  await page.setViewportSize({ width: 1440, height: 900 });

  await page.goto('/settings/tokens');
  const answer = await request.get('/api/v1/tokens?limit=1000');
  const { items } = (await answer.json()) as { items: { name: string }[] };
  await expect(page.getByRole('rowheader')).toHaveCount(items.length);
  const names = await page.getByRole('rowheader').allTextContents();
  expect(names.toSorted()).toEqual(items.map(({ name }) => name).toSorted());
  await nothingGrew();

  await page.goto('/audit?action=token.create');
  await expect(page.getByRole('row').filter({ hasText: 'What changed' })).toHaveCount(items.length);
  for (const summary of (await page.getByText('What changed').all()).slice(0, 12)) {
    await summary.click();
  }
  await nothingGrew();
  await accessible(page);

  /** Asserts that the page has nothing that the tricks would make. */
  async function nothingGrew() {
    const grown = page.locator(
      'main :is(script, img, iframe, object, video, base, meta, link, style, math, [onerror], [onload])',
    );
    await expect(grown).toHaveCount(0);
    await expect(page.locator('a[href^="javascript:"]')).toHaveCount(0);
  }
});

test('a hostile address is a robot that is not there', async ({ page, account }) => {
  // No page of the dashboard has an ending: what has a point is a file that is not there.
  const addresses = TRICKS.filter((trick) => !trick.includes('.')).slice(0, 12);
  for (const trick of addresses) {
    await page.goto(`/robots/${encodeURIComponent(trick)}`);
    await expect(page.getByRole('heading', { level: 1 })).toBeVisible();
    await expect(page.getByRole('main')).toContainText(trick);
  }
  account.forgive(/status of 40[04]/);
});
