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
    const short = entry.label || name.replace(/^(mechanism\.set|initial)\./, '');
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
    row.append(field, make('span', { className: 'unit', textContent: entry.unit, title: entry.unit }), why);
    row.dataset.name = name;
    place.append(row);
    rows.set(name, { entry, row, field, hint, slider, why, short });
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

  let newest = 0, shown = '[]', isMoving = false, isStale = false, isResting = true, resting = 0, summary = dockloop.data.summary, pictures = [];
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
    const request = { settings: Object.fromEntries(settings), coarse };
    let [status, answer] = await ask('run', request);
    if (status === 409 && mine === newest) [status, answer] = await ask('run', request); // one before has overtaken it
    if (mine !== newest) return false;
    $('stop').disabled = true;
    const isShown = status === 200;
    if (isShown) {
      refuse('', '');
      shown = asked;
      summary = answer.summary;
      if (answer.defaults) showDefaults(answer.defaults);
      dockloop.load(answer, coarse);
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
    turn += 1;
    isResting = false;
    isStale = true;
    map.draw();
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
    isResting = await compute(false);
    fill();
  }
  let turn = 0; // of what is computed while nothing else runs: another one ends it
  async function fill() {
    const mine = ++turn;
    if (!isResting) return;
    await findErrors(() => mine === turn);
    if (mine === turn) await map.fill(() => mine === turn);
  }
  function stop() {
    clearTimeout(resting);
    turn += 1;
    isStale = false;
    newest += 1;
    $('stop').disabled = true;
    $('status').textContent = 'stopped';
    ask('stop', {});
  }

  // ------------------------------------------------------------------ figures, the kept docking

  let kept = null; // the kept docking: its summary and settings
  const errors = new Map(); // by settings: figures with tighter settings, or why there are none
  const say = (x) => (x === null || x === undefined ? '\u2013' : typeof x === 'number' ? String(Number(x.toPrecision(4))) : x);
  const say2 = (x) => (x && Math.abs(x) < 1e-2 ? x.toExponential(1) : String(Number(x.toPrecision(2)))); // two digits
  function listFigures(of) {
    const found = [['outcome', '', of.outcome], ['first contact', 's', of.time_of_contact], ['capture', 's', of.time_of_capture]];
    for (const [name, load] of Object.entries(of.peak_loads || {})) found.push([name, load.unit, load.value, load.rated]);
    if (of.energy) found.push(['absorbed', 'J', of.energy.dissipated]);
    if (of.legs) found.push(['leg force', 'N', of.legs.largest_force]);
    return found.filter(([, , x]) => x !== undefined);
  }
  /** Find the errors of the docking that is shown, and of the kept one. */
  async function findErrors(isWanted) {
    for (const key of kept ? [shown, kept.settings] : []) {
      if (errors.has(key)) continue;
      const [status, answer] = await ask('errors', { settings: Object.fromEntries(JSON.parse(key)) });
      if (!isWanted() || ![200, 422].includes(status)) return;
      if (errors.size > 100) errors.clear();
      errors.set(key, answer);
      showFigures();
    }
  }
  /** What is known of the error of a figure: a number, null (none can be had), undefined (not yet). */
  function errorOf(key, name, x) {
    if (!errors.has(key)) return undefined;
    const { tighter } = errors.get(key), exact = tighter && new Map(listFigures(tighter).map((row) => [row[0], row[2]])).get(name);
    return typeof exact === 'number' && typeof x === 'number' ? Math.abs(x - exact) : null;
  }
  const sayError = (error) => (error === undefined ? '...' : error === null ? 'not known' : `\u00b1 ${say2(error)}`);
  function showFigures() {
    const { warnings } = dockloop.data;
    $('warnings').textContent = warnings.length ? `${warnings.length === 1 ? 'warning' : `${warnings.length} warnings`}: ${warnings.join(' ')}` : '';
    $('warnings').title = warnings.join('\n');
    const before = kept && new Map(listFigures(kept.summary).map((row) => [row[0], row[2]]));
    const head = ['', 'now', ...(kept ? ['kept', 'change'] : ['rated', 'of rated'])];
    $('figures').tHead.replaceChildren(make('tr', {}, ...head.map((text) => make('th', { textContent: text }))));
    $('figures').tBodies[0].replaceChildren(...listFigures(summary).map(([name, unit, x, rated]) => {
      const other = before?.get(name), isNumber = typeof x === 'number' && typeof other === 'number';
      const change = isNumber ? (other ? `${x > other ? '+' : ''}${say2((x / other - 1) * 100)} %` : say(x - other)) : x === other ? '' : 'differs';
      const part = rated ? `${((100 * x) / rated).toFixed(1)} %` : '';
      const cells = [[`${say(x)} ${unit}`], ...(kept ? [[say(other)], [change]] : [[rated ? say(rated) : ''], [part]])];
      if (isNumber) {
        const [mine, its] = [[shown, x], [kept.settings, other]].map(([key, figure]) => errorOf(key, name, figure));
        [mine, its].forEach((error, k) => cells[k].push(sayError(error)));
        cells[2].push(Math.abs(x - other) <= mine + its ? 'within error' : '');
      }
      const label = make('th', { textContent: name, title: name });
      if (kept && part) label.append(make('small', { textContent: `${part} of rated` }));
      const row = make('tr', {}, label, ...cells.map(([text, error]) => {
        const cell = make('td', { textContent: text, title: text });
        if (error !== undefined) cell.append(make('small', { textContent: error }));
        return cell;
      }));
      row.classList.toggle('over', Boolean(rated && x > rated));
      row.classList.toggle('same', row.textContent.endsWith('within error'));
      return row;
    }));
    const said = kept ? [shown, kept.settings].map((key) => errors.get(key)) : [];
    $('figures').title = said.map((one, k) => one && `error of the ${k ? 'kept' : 'present'} one: ${one.sentence || one.error}`).filter(Boolean).join('\n');
  }
  function keep(data) {
    kept = data && { summary, settings: shown };
    dockloop.keep(data);
    $('forget').disabled = !data;
    showFigures();
    fill();
  }

  // ------------------------------------------------------------------ where it holds: over one quantity, or two

  const map = (() => {
    const COUNT = 33, ROWS = 17; // values across; upwards, if there is a second quantity
    const sheet = make('canvas', { tabIndex: 0 }), words = make('small', { className: 'words' }), where = make('output', { className: 'words' });
    const second = make('select'), choice = make('label', { className: 'second' }, 'and over ', second);
    sheet.setAttribute('role', 'application');
    let name = '', other = '', key = '', cells = [], cursor = null;
    const rowCount = () => (other ? ROWS : 1), wrap = (k, count) => Math.min(count - 1, Math.max(0, k));
    const at = (k, of = name, count = COUNT) => fromSlider(byName.get(of).range, (k * STEPS) / (count - 1));
    const settingsAt = ([k, j]) => ({ ...(other && { [other]: at(j, other, ROWS) }), [name]: at(k) });
    const restOf = () => [...settings].filter(([each]) => each !== name && each !== other);
    const keyNow = () => JSON.stringify([name, other, restOf()]);
    const part = (of) => Math.max(0, ...Object.values(of.peak_loads || {}).map((load) => load.ratio ?? 0));
    /** Places from coarse to fine, each with the width of its block. */
    function* list() {
      const seen = new Set();
      for (let step = COUNT - 1; step >= 1; step /= 2) {
        for (let j = 0; j < rowCount(); j += Math.min(step, ROWS - 1)) for (let k = 0; k < COUNT; k += step) {
          if (!seen.has(j * COUNT + k)) yield [k, j, step];
          seen.add(j * COUNT + k);
        }
      }
    }
    const cellAt = ([k, j]) => (k >= 0 && j >= 0 && k < COUNT ? cells[j * COUNT + k] : undefined);
    const sayCell = (place) => {
      const cell = cellAt(place), values = Object.entries(settingsAt(place)).map(([each, x]) => `${rows.get(each).short} ${x} ${byName.get(each).unit}`).join(', ');
      return `${values}: ${!cell ? '...' : cell.error || `${cell.outcome}${cell.part ? `, ${(100 * cell.part).toFixed(0)} % of rated` : ''}`}`;
    };
    function draw() {
      if (!name) return;
      const { clientWidth: w, clientHeight: h } = sheet, ratio = Math.min(devicePixelRatio || 1, 2), { colors, outcomes } = dockloop.data.meta;
      const count = rowCount(), wide = w / COUNT, high = other ? h / count : 8, colorOf = (outcome) => colors.outcome[outcomes.indexOf(outcome)];
      sheet.width = w * ratio;
      sheet.height = h * ratio;
      sheet.classList.toggle('old', key !== keyNow());
      const pen = sheet.getContext('2d');
      pen.scale(ratio, ratio);
      pen.fillStyle = '#f3f6f9';
      pen.fillRect(0, 0, w, h);
      for (const [k, j, step] of list()) { // a coarse one stands for those near it that are not there yet
        const cell = cellAt([k, j]), half = other ? step / 2 : 0.5;
        if (!cell) continue;
        const [left, right, top, bottom] = [(k + 0.5 - half) * wide, (k + 0.5 + half) * wide, h - (j + 0.5 + half) * high, h - (j + 0.5 - half) * high].map(Math.round);
        const box = [left, top, right - left, bottom - top];
        pen.fillStyle = cell.error ? '#f3f6f9' : colorOf(cell.outcome);
        if (other) pen.clearRect(...box);
        pen.globalAlpha = other && !cell.error ? 0.35 + 0.65 * Math.min(1, cell.part) : 1;
        pen.fillRect(...box);
        pen.globalAlpha = 1;
        pen.fillStyle = cell.error ? colors.faint : colors.ink;
        if (cell.error) for (let y = other ? top : 0; y < (other ? bottom : h); y += 4) pen.fillRect(left, y, right - left, 1);
        else if (!other) pen.fillRect(left, (h - 9) * (1 - Math.min(1, cell.part)), wide - 1, 2);
      }
      pen.fillStyle = colors.ink; // the boundary of an outcome and of rated loads, where both neighbours are known
      cells.forEach((cell, i) => {
        const k = i % COUNT, j = Math.floor(i / COUNT), differs = (near) => near && (near.outcome !== cell.outcome || (near.part > 1) !== (cell.part > 1));
        if (differs(cellAt([k - 1, j]))) pen.fillRect(k * wide - 1, other ? h - (j + 1) * high : 0, 2, other ? high : h);
        if (differs(cellAt([k, j - 1]))) pen.fillRect(k * wide, h - j * high - 1, wide, 2);
      });
      const place = (of, count) => (toSlider(byName.get(of).range, Number(textOf(of))) / STEPS) * (count - 1) + 0.5;
      if (other) { // the docking that is shown
        pen.lineWidth = 2;
        for (const [color, radius] of [['#fff', 6], [colors.ink, 4.5]]) {
          pen.strokeStyle = color;
          pen.beginPath();
          pen.arc(place(name, COUNT) * wide, h - place(other, ROWS) * high, radius, 0, 7);
          pen.stroke();
        }
      }
      if (cursor) {
        pen.strokeStyle = colors.ink;
        pen.lineWidth = 2;
        pen.strokeRect(cursor[0] * wide + 1, other ? h - (cursor[1] + 1) * high + 1 : 1, wide - 2, (other ? high : h) - 2);
      }
      const found = [...new Set(cells.map((cell) => cell.outcome).filter(Boolean))];
      words.replaceChildren(...found.map((outcome) => {
        const mark = make('i');
        mark.style.background = colorOf(outcome);
        return make('span', {}, mark, outcome);
      }), make('span', {}, other ? 'full colour: rated load' : 'line: largest load, top = rated'));
      where.textContent = cursor ? sayCell(cursor) : other ? `across ${rows.get(name).short}, up ${rows.get(other).short}` : '';
      const text = `outcome (colour) and largest load over its rated one over ${name}${other && ` and ${other}`}; click, or arrows and enter: that docking`;
      sheet.title = text;
      sheet.setAttribute('aria-label', other ? text : `${text}: ${cells.map((c, k) => `${at(k)} ${c.outcome || 'refused'}`).join(', ')}`);
    }
    function point(place) {
      cursor = place;
      draw();
    }
    const placeOf = (event) => [wrap(Math.floor((event.offsetX / sheet.clientWidth) * COUNT), COUNT), wrap(Math.floor((1 - event.offsetY / sheet.clientHeight) * rowCount()), rowCount())];
    function go(place) {
      for (const [each, text] of Object.entries(settingsAt(place))) change(each, text); // the one across last
      commit();
    }
    sheet.addEventListener('click', (event) => go(placeOf(event)));
    sheet.addEventListener('pointermove', (event) => point(placeOf(event)));
    for (const leave of ['pointerleave', 'blur']) sheet.addEventListener(leave, () => point(null));
    sheet.addEventListener('keydown', (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key], [k, j] = cursor || [(COUNT - 1) / 2, (rowCount() - 1) / 2];
      if (way) point(cursor ? [wrap(k + way[0], COUNT), wrap(j + way[1], rowCount())] : [k, j]);
      else if (cursor && [' ', 'Enter'].includes(event.key)) go(cursor);
      else return;
      event.preventDefault();
    });
    second.addEventListener('change', () => { other = second.value; fill(); });
    return {
      draw,
      /** Fill the strip of the last slider, or the map, one docking after the other, while it is wanted. */
      async fill(isWanted) {
        if (!other && rows.get(touched)?.slider && name !== touched) { // the axes of a map stay
          name = touched;
          rows.get(name).row.append(sheet, where, words, choice);
          second.replaceChildren(new Option('nothing else', ''), ...[...rows].filter(([each, { slider }]) => slider && each !== name).map(([each, { short }]) => new Option(short, each)));
        }
        if (!name) return;
        if (key !== keyNow()) [key, cells, cursor] = [keyNow(), [], null];
        sheet.classList.toggle('map', Boolean(other));
        draw();
        for (const [k, j] of list()) {
          if (cellAt([k, j])) continue;
          const [status, answer] = await ask('run', { settings: { ...Object.fromEntries(restOf()), ...settingsAt([k, j]) }, coarse: true, brief: true });
          if (!isWanted() || ![200, 422].includes(status)) return;
          cells[j * COUNT + k] = status === 200 ? { outcome: answer.summary.outcome, part: part(answer.summary) } : { error: answer.error };
          draw();
        }
      },
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
  window.live = { change, commit, get pictures() { return pictures; }, get settings() { return [...settings]; }, get summary() { return summary; }, get cells() { return map.cells; } };
})();
