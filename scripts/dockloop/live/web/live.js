// The panel of `dockloop live`: settings, requests to the server, undo, what is taken home, the kept docking.
// While a setting changes one coarse docking after another is asked for, always of the newest settings; when it
// rests, the docking of `dockloop run`. The server ends what is not wanted any more.
'use strict';
(() => {
  const $ = (id) => document.getElementById(id);
  const make = (tag, more = {}, ...children) => {
    const made = Object.assign(document.createElement(tag), more);
    made.append(...children);
    return made;
  };
  const { entries, headings } = dockloop.data.live;
  const byName = new Map(entries.map((entry) => [entry.name, entry]));
  const rows = new Map();
  const REST = 150; // ms without a change, after which the docking is refined
  let settings = new Map(); // those that were made, as texts; a default too: it may follow from another setting
  let touched = ''; // the setting that was changed last

  // ------------------------------------------------------------------ settings

  const textOf = (name) => settings.get(name) ?? byName.get(name)?.default ?? '';
  const snapshot = () => JSON.stringify([...settings]);

  function change(name, text) {
    touched = name;
    if (text) settings.set(name, text); else settings.delete(name);
    showRow(name);
    move();
  }
  const STEPS = 1000; // of a slider
  function fromSlider([low, high, isLog], k) {
    if (isLog) return String(Number((low * (high / low) ** (k / STEPS)).toPrecision(3)));
    const digits = Math.max(0, Math.ceil(-Math.log10((high - low) / STEPS)));
    return String(Number((low + ((high - low) * k) / STEPS).toFixed(Math.min(20, digits))));
  }
  const toSlider = ([low, high, isLog], x) => STEPS * (isLog ? Math.log(x / low) / Math.log(high / low) : (x - low) / (high - low));

  function addRow(name, heading) {
    if (rows.has(name)) return rows.get(name);
    const entry = byName.get(name) || { default: '', unit: '', limits: '', meaning: '' };
    let place = [...$('settings').children].find((set) => set.dataset.heading === heading);
    if (!place) {
      place = make('fieldset', {}, make('legend', { textContent: heading }));
      place.dataset.heading = heading;
      $('settings').append(place);
    }
    const short = name.replace(/^(mechanism\.set|initial)\./, '');
    const id = `set ${name}`.replaceAll(' ', '_');
    const field = make('input', { type: 'text', id, spellcheck: false, autocomplete: 'off' });
    const hint = make('small');
    const label = make('label', { htmlFor: id, title: `${name}: ${entry.meaning}` }, make('span', { textContent: byName.has(short) ? name : short }), hint);
    const why = make('output', { className: 'why', id: `${id}_why` });
    const row = make('div', { className: 'setting' }, label);
    field.setAttribute('aria-describedby', why.id);
    field.addEventListener('change', () => { change(name, field.value.trim()); commit(); });
    let slider = null;
    if (entry.range) {
      slider = make('input', { type: 'range', min: 0, max: STEPS, step: 1 });
      slider.setAttribute('aria-label', name);
      slider.addEventListener('input', () => change(name, fromSlider(entry.range, Number(slider.value))));
      slider.addEventListener('change', commit);
      row.append(slider);
    }
    row.append(field, make('span', { className: 'unit', textContent: entry.unit }), why);
    row.dataset.name = name;
    place.append(row);
    rows.set(name, { entry, row, field, hint, slider, why });
    showRow(name);
    return rows.get(name);
  }
  function showRow(name) {
    const { entry, row, field, hint, slider } = addRow(name, 'chosen'), text = textOf(name);
    if (field.value !== text) field.value = text;
    hint.textContent = [entry.default && `default ${entry.default}`, entry.limits].filter(Boolean).join(', ');
    row.classList.toggle('changed', settings.has(name));
    if (slider) {
      const x = Number(text);
      slider.value = toSlider(entry.range, x);
      slider.setAttribute('aria-valuetext', `${text} ${entry.unit}`);
    }
  }
  /** Show the defaults that follow from the settings, but not in a field that is being typed in. */
  function showDefaults(defaults) {
    for (const entry of entries) {
      const before = textOf(entry.name), field = rows.get(entry.name)?.field;
      entry.default = defaults[entry.name] ?? entry.default;
      if (field?.value === before) showRow(entry.name);
    }
  }
  function refuse(name, sentence) {
    for (const { field, why } of rows.values()) {
      why.textContent = '';
      field.removeAttribute('aria-invalid');
    }
    const row = rows.get(name);
    $('refused').textContent = row ? '' : sentence;
    if (!row || !sentence) return;
    row.why.textContent = sentence;
    row.field.setAttribute('aria-invalid', 'true');
  }

  // ------------------------------------------------------------------ undo, link

  const past = [], future = [];
  let present = '[]';
  function commit() {
    const now = snapshot();
    if (now === present) return;
    remember();
    settle(now);
  }
  function remember() {
    past.push(present);
    future.length = 0;
  }
  const linkOf = (text) => (text === '[]' ? '' : `#${encodeURIComponent(text)}`);
  /** Make these settings the present ones of undo, buttons and address. */
  function settle(now) {
    present = now;
    $('undo').disabled = !past.length;
    $('redo').disabled = !future.length;
    $('reset').disabled = now === '[]';
    history.replaceState(null, '', `${location.pathname}${linkOf(now)}`);
  }
  function apply(text) {
    const before = [...settings.keys()];
    settings = new Map(JSON.parse(text));
    for (const name of new Set([...before, ...settings.keys()])) showRow(name);
    settle(text);
    move();
  }
  function go(from, to) {
    if (!from.length) return;
    to.push(present);
    apply(from.pop());
  }
  function reset() {
    if (present === '[]') return;
    remember();
    apply('[]');
  }
  function readLink() {
    if (!location.hash) return;
    try {
      const pairs = JSON.parse(decodeURIComponent(location.hash.slice(1)));
      if (!pairs.every((pair) => pair.length === 2 && pair.every((text) => typeof text === 'string'))) throw new Error();
      if (JSON.stringify(pairs) === present) return;
      remember();
      apply(JSON.stringify(pairs));
    } catch {
      refuse('', 'The part of the address after # holds no settings: copy the whole link.');
    }
  }

  // ------------------------------------------------------------------ requests

  let newest = 0, shown = '[]', isMoving = false, isStale = false, resting = 0, summary = dockloop.data.summary, pictures = [];
  async function ask(what, request) {
    try {
      const answer = await fetch(what, {
        method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(request),
      });
      return [answer.status, await answer.json()];
    } catch {
      return [0, { error: 'The server has ended: start dockloop live again.' }];
    }
  }
  /** Compute and show the docking of the present settings; true if it is shown. */
  async function compute(coarse) {
    const mine = ++newest, asked = snapshot(), began = performance.now();
    $('stop').disabled = false;
    $('status').textContent = coarse ? 'computing ...' : 'refining ...';
    const [status, answer] = await ask('run', { settings: Object.fromEntries(settings), coarse });
    if (mine !== newest) return false;
    $('stop').disabled = true;
    const isShown = status === 200;
    if (isShown) {
      refuse('', '');
      shown = asked;
      summary = answer.summary;
      if (answer.defaults) showDefaults(answer.defaults);
      dockloop.load(answer);
      showFigures();
      const took = performance.now() - began;
      pictures = [...pictures, took].slice(-1000);
      $('status').textContent = `${coarse ? 'coarse' : 'as dockloop run'}, ${took.toFixed(0)} ms`;
    } else if (status === 409) $('status').textContent = 'stopped';
    else {
      refuse(answer.name || (status === 422 ? touched : ''), answer.error);
      $('status').textContent = 'refused: the docking before is shown';
    }
    return isShown;
  }
  async function move() {
    clearTimeout(resting);
    strip.stop();
    isStale = true;
    if (isMoving) return;
    isMoving = true;
    let isShown = false;
    while (isStale) {
      isStale = false;
      isShown = await compute(true);
    }
    isMoving = false;
    if (isShown) resting = setTimeout(refine, REST);
  }
  async function refine() {
    if (await compute(false)) strip.fill();
  }
  function stop() {
    clearTimeout(resting);
    strip.stop();
    isStale = false;
    newest += 1;
    $('stop').disabled = true;
    $('status').textContent = 'stopped';
    ask('stop', {});
  }

  // ------------------------------------------------------------------ figures, the kept docking

  let kept = null;
  const say = (x) => (x === null || x === undefined ? '\u2013' : typeof x === 'number' ? String(Number(x.toPrecision(4))) : x);
  function listFigures(of) {
    const found = [['outcome', '', of.outcome], ['first contact', 's', of.time_of_contact], ['capture', 's', of.time_of_capture]];
    for (const [name, load] of Object.entries(of.peak_loads || {})) found.push([name, load.unit, load.value, load.rated]);
    if (of.energy) found.push(['absorbed', 'J', of.energy.dissipated]);
    if (of.legs) found.push(['leg force', 'N', of.legs.largest_force]);
    return found.filter(([, , x]) => x !== undefined);
  }
  function showFigures() {
    const { warnings } = dockloop.data;
    $('warnings').textContent = warnings.length ? `${warnings.length === 1 ? 'warning' : `${warnings.length} warnings`}: ${warnings.join(' ')}` : '';
    $('warnings').title = warnings.join('\n');
    const before = kept && new Map(listFigures(kept.summary).map((row) => [row[0], row[2]]));
    const head = ['', 'now', ...(kept ? ['kept', 'change'] : ['rated', 'of rated'])];
    $('figures').tHead.replaceChildren(make('tr', {}, ...head.map((text) => make('th', { textContent: text }))));
    $('figures').tBodies[0].replaceChildren(...listFigures(summary).map(([name, unit, x, rated]) => {
      const other = before?.get(name), isNumber = typeof x === 'number' && typeof other === 'number';
      const change = isNumber ? (other ? `${x >= other ? '+' : ''}${((x / other - 1) * 100).toFixed(1)} %` : say(x - other)) : x === other ? '' : 'differs';
      const more = kept ? [say(other), change] : [rated ? say(rated) : '', rated ? `${((100 * x) / rated).toFixed(1)} %` : ''];
      const row = make('tr', {}, make('th', { textContent: name, title: unit }), ...[`${say(x)} ${unit}`, ...more].map((text) => make('td', { textContent: text, title: text })));
      row.classList.toggle('over', Boolean(rated && x > rated));
      return row;
    }));
  }
  function keep(data) {
    kept = data;
    dockloop.keep(data);
    $('forget').disabled = !data;
    showFigures();
  }

  // ------------------------------------------------------------------ where it holds

  const strip = (() => {
    const COUNT = 33, sheet = make('canvas'), words = make('small', { className: 'words' });
    sheet.setAttribute('role', 'img');
    let name = '', key = '', cells = [], turn = 0;
    const order = [];
    for (let step = 32; step >= 1; step /= 2) for (let k = 0; k < COUNT; k += step) if (!order.includes(k)) order.push(k);
    const at = (k) => fromSlider(byName.get(name).range, (k * STEPS) / (COUNT - 1));
    const part = (of) => Math.max(0, ...Object.values(of.peak_loads || {}).map((load) => load.ratio ?? 0));
    function draw() {
      const { clientWidth: w, clientHeight: h } = sheet, ratio = Math.min(devicePixelRatio || 1, 2), colors = dockloop.data.meta.colors;
      sheet.width = w * ratio;
      sheet.height = h * ratio;
      const pen = sheet.getContext('2d');
      pen.scale(ratio, ratio);
      pen.fillStyle = '#f3f6f9';
      pen.fillRect(0, 0, w, h);
      cells.forEach((cell, k) => {
        const from = (k * w) / COUNT, wide = w / COUNT;
        if (cell.error) {
          pen.fillStyle = colors.faint;
          for (let y = 0; y < h; y += 4) pen.fillRect(from, y, wide, 1);
          return;
        }
        pen.fillStyle = colors.outcome[dockloop.data.meta.outcomes.indexOf(cell.outcome)];
        pen.fillRect(from, h - 8, wide + 0.5, 8);
        pen.fillStyle = colors.ink;
        pen.fillRect(from, (h - 9) * (1 - Math.min(1, part(cell))), wide - 1, 2);
        if (cells[k - 1] && cells[k - 1].outcome !== cell.outcome) pen.fillRect(from - 1, 0, 2, h);
      });
      const outcomes = [...new Set(cells.map((cell) => cell.outcome).filter(Boolean))];
      words.replaceChildren(...outcomes.map((outcome) => {
        const mark = make('i');
        mark.style.background = colors.outcome[dockloop.data.meta.outcomes.indexOf(outcome)];
        return make('span', {}, mark, outcome);
      }), 'line: largest load, top = rated');
      sheet.title = `outcome (colour) and largest load over its rated one (line, full height: 100 %) over ${name}; click: that docking`;
      sheet.setAttribute('aria-label', `${sheet.title}: ${cells.map((c, k) => `${at(k)} ${c.outcome || 'refused'}`).join(', ')}`);
    }
    sheet.addEventListener('click', (event) => {
      const k = Math.floor((event.offsetX / sheet.clientWidth) * COUNT);
      change(name, at(Math.min(COUNT - 1, Math.max(0, k))));
      commit();
    });
    return {
      /** Fill the strip of the last slider, one docking after the other, until `stop`. */
      async fill() {
        if (!rows.get(touched)?.slider) return;
        const mine = ++turn;
        const others = Object.fromEntries([...settings].filter(([other]) => other !== touched));
        const now = JSON.stringify([touched, others]);
        if (now !== key) {
          [name, key, cells] = [touched, now, []];
          rows.get(name).row.append(sheet, words);
          draw();
        }
        for (const k of order) {
          if (cells[k]) continue;
          const [status, answer] = await ask('run', { settings: { ...others, [name]: at(k) }, coarse: true, brief: true });
          if (mine !== turn || ![200, 422].includes(status)) return;
          cells[k] = status === 200 ? answer.summary : { error: answer.error };
          draw();
        }
      },
      stop() { turn += 1; },
      get cells() { return cells; },
    };
  })();

  // ------------------------------------------------------------------ what is taken home: the docking that is shown

  function download(name, blob) {
    const link = make('a', { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
  function offer(text) {
    $('text').value = text;
    navigator.clipboard?.writeText(text).catch(() => {}); // the text can be copied by hand
  }
  for (const button of document.querySelectorAll('#home [data-text]')) {
    button.addEventListener('click', async () => {
      const what = button.dataset.text, [status, answer] = await ask('export', { settings: Object.fromEntries(JSON.parse(shown)) });
      offer(status === 200 ? answer[what] : answer.error);
      if (status === 200 && what === 'scene') download(`${dockloop.data.meta.name}_live.toml`, new Blob([answer.scene]));
    });
  }
  $('link').addEventListener('click', () => offer(`${location.origin}${location.pathname}${linkOf(shown)}`));
  $('picture').addEventListener('click', () => $('space').toBlob((blob) => download(`${dockloop.data.meta.name}.png`, blob)));

  // ------------------------------------------------------------------ controls

  function search() {
    const words = $('find').value.toLowerCase().split(/\s+/).filter(Boolean);
    const fits = (entry) => words.every((word) => `${entry.name} ${entry.meaning}`.toLowerCase().includes(word));
    const found = words.length ? entries.filter(fits) : [];
    $('found').replaceChildren(...found.slice(0, 40).map((entry) => {
      const text = [`${entry.name} = ${entry.default || '\u2013'} ${entry.unit}`, entry.limits, entry.meaning].filter(Boolean).join('; ');
      const button = make('button', { type: 'button', textContent: text });
      button.addEventListener('click', () => {
        addRow(entry.name, 'chosen').field.focus();
        $('find').value = '';
        search();
      });
      return make('li', {}, button);
    }));
    if (words.length) $('found').append(make('li', { textContent: found.length > 40 ? `and ${found.length - 40} more` : found.length ? '' : 'no name is like that' }));
  }
  $('find').addEventListener('input', search);
  $('undo').addEventListener('click', () => go(past, future));
  $('redo').addEventListener('click', () => go(future, past));
  $('reset').addEventListener('click', reset);
  $('stop').addEventListener('click', stop);
  $('keep').addEventListener('click', () => keep(dockloop.data));
  $('forget').addEventListener('click', () => keep(null));
  document.addEventListener('keydown', (event) => {
    const isText = event.target.type === 'text' || event.target.type === 'search';
    const key = event.ctrlKey || event.metaKey ? `ctrl ${event.key.toLowerCase()}` : event.key;
    if (key === 'Escape') stop();
    else if (key === '/' && !isText) $('find').focus();
    else if (key === 'ctrl z' && !isText) (event.shiftKey ? go(future, past) : go(past, future));
    else if (key === 'ctrl y' && !isText) go(future, past);
    else return;
    event.preventDefault();
  });
  window.addEventListener('hashchange', readLink);

  for (const heading of headings) for (const entry of entries) if (entry.heading === heading) addRow(entry.name, heading);
  $('stop').disabled = true;
  showFigures();
  $('status').textContent = 'as dockloop run';
  if (location.hash) readLink(); else settle(present);
  window.live = { change, commit, get pictures() { return pictures; }, get settings() { return [...settings]; }, get summary() { return summary; }, get cells() { return strip.cells; } };
})();
