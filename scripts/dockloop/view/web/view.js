// The page of `dockloop view`: motion, curves and time of one docking. Poses are those of the result, in axes
// of A; between samples positions are interpolated linearly and attitudes on the shortest turn, anything
// else keeps the value of the sample before.
'use strict';
(() => {
  let data = JSON.parse(document.getElementById('data').textContent);
  let { meta, geometry, events } = data;
  const $ = (id) => document.getElementById(id);
  const COLORS = meta.colors;
  const LOAD_NAMES = Object.keys(meta.loads);

  // ------------------------------------------------------------------ columns

  function unpack(packed) {
    const found = {};
    for (const [name, column] of Object.entries(packed)) {
      const text = atob(column.data), bytes = new Uint8Array(text.length);
      for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i); // ten times as fast as `from`
      found[name] = column.type === 'f8' ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer);
    }
    return found;
  }
  let columns = unpack(data.columns), times = columns.time, last = times.length - 1;
  const has = (name) => name in columns;
  const value = (name, i) => (has(name) ? columns[name][i] : NaN);
  const list = (pattern) => {
    const found = [];
    for (let i = 1; has(pattern.replace('#', i)); i++) found.push(pattern.replace('#', i));
    return found;
  };
  let latches, legForces, petalForces, surfaceForces, hasTarget, hasRing;
  function findColumns() {
    latches = list('latch[#].state');
    legForces = list('leg[#].force');
    petalForces = list('contact.petal[#].force');
    surfaceForces = list('contact.surface[#].force');
    hasTarget = 'target' in geometry.vehicles && has('pose.target');
    hasRing = has('pose.ring');
  }
  const NOISE = 1e-6; // N: smaller forces are rounding
  const orNone = (force) => (force > NOISE ? force : 0);
  const largest = (names) => orNone(names.reduce((m, n) => columns[n].reduce((a, x) => Math.max(a, Math.abs(x)), m), 0));

  let kept = null; // columns of another recording that is laid under this one

  /** Last sample at or before t. */
  function findSample(t, of = columns) {
    let low = 0, high = of.time.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (of.time[middle] <= t + 1e-12) low = middle; else high = middle - 1;
    }
    return low;
  }

  /** Pose of a body in axes of A at t: position p, quaternion q (w, x, y, z). */
  function findPose(name, t, of = columns) {
    const rows = of[`pose.${name}`];
    if (!rows) return { p: [0, 0, 0], q: [1, 0, 0, 0] };
    const i = findSample(t, of), at = 7 * i;
    const p = [rows[at], rows[at + 1], rows[at + 2]];
    const q = [rows[at + 3], rows[at + 4], rows[at + 5], rows[at + 6]];
    if (i + 1 < of.time.length && t > of.time[i] + 1e-12) {
      const f = (t - of.time[i]) / (of.time[i + 1] - of.time[i]);
      for (let k = 0; k < 3; k++) p[k] += f * (rows[at + 7 + k] - p[k]);
      let dot = 0;
      for (let k = 0; k < 4; k++) dot += q[k] * rows[at + 10 + k];
      const angle = Math.acos(Math.min(1, Math.abs(dot))), sine = Math.sin(angle);
      const a = sine > 1e-6 ? Math.sin((1 - f) * angle) / sine : 1 - f;
      const b = (sine > 1e-6 ? Math.sin(f * angle) / sine : f) * (dot < 0 ? -1 : 1);
      for (let k = 0; k < 4; k++) q[k] = a * q[k] + b * rows[at + 10 + k];
    }
    const norm = Math.hypot(...q);
    return { p, q: q.map((x) => x / norm) };
  }

  // ------------------------------------------------------------------ the space

  const space = $('space');
  const context = space.getContext('webgl2', { antialias: false, preserveDrawingBuffer: true, alpha: false });
  let view = null;
  const SLOW = 25; // ms: where a program draws the space, no graphics hardware
  /** Pixels drawn for one of the page, along an edge. They smooth edges, for less than multisampling costs a program. */
  const findFineness = () => 2 * Math.min(window.devicePixelRatio || 1, 1.5);

  /** Build what is drawn; `before`, of the docking before, hands over renderer, camera and state. */
  function makeView(before) {
    const T = THREE;
    const extent = geometry.extent; // sizes of symbols, frames, arrows and cameras follow it [m]
    const renderer = before?.renderer || new T.WebGLRenderer({ canvas: space, context });
    renderer.setPixelRatio(findFineness());
    const scene = new T.Scene();
    scene.background = new T.Color('#f7f9fb');
    scene.add(new T.HemisphereLight('#ffffff', '#a8b2bd', 2.2));
    const camera = before?.camera || new T.PerspectiveCamera(35, 1);
    camera.near = 0.025 * extent;
    camera.far = 2500 * extent + 100;
    camera.updateProjectionMatrix();
    camera.up.set(0, 0, 1);
    camera.clear();
    const lamp = new T.DirectionalLight('#ffffff', 1.5);
    lamp.position.set(-0.4, 0.7, 1);
    camera.add(lamp);
    scene.add(camera);
    const world = new T.Group(); // axes of A
    world.matrixAutoUpdate = false;
    scene.add(world);
    const controls = before?.controls || new T.OrbitControls(camera, space);
    controls.enableDamping = false;
    controls.minDistance = 0.25 * extent;
    controls.maxDistance = 500 * extent + 20;

    const vector = (a) => new T.Vector3(a[0], a[1], a[2]);
    const quaternion = (q) => new T.Quaternion(q[1], q[2], q[3], q[0]);
    const solid = (color, more = {}) => new T.MeshLambertMaterial({ color, side: T.DoubleSide, ...more });
    const place = (object, pose) => {
      object.position.set(...pose.p);
      object.quaternion.copy(quaternion(pose.q));
    };
    const group = (parent, pose) => {
      const made = new T.Group();
      if (pose) place(made, pose);
      parent.add(made);
      return made;
    };
    const UP = new T.Vector3(0, 1, 0);
    /** Lay a mesh that is 1 long along y between two points. */
    function span(mesh, from, to) {
      const way = to.clone().sub(from), length = way.length();
      mesh.visible = length > 1e-9;
      mesh.position.copy(from).addScaledVector(way, 0.5);
      if (length > 1e-9) mesh.quaternion.setFromUnitVectors(UP, way.divideScalar(length));
      mesh.scale.y = length;
    }
    const rod = (parent, radius, material, sides = 20) => {
      const mesh = new T.Mesh(new T.CylinderGeometry(radius, radius, 1, sides), material);
      parent.add(mesh);
      return mesh;
    };
    const ball = (parent, at, radius, material) => {
      const mesh = new T.Mesh(new T.SphereGeometry(radius, 20, 14), material);
      mesh.position.copy(at);
      parent.add(mesh);
      return mesh;
    };

    function addLabel(parent, text, at, color, size) {
      const sheet = document.createElement('canvas');
      sheet.width = 256;
      sheet.height = 64;
      const pen = sheet.getContext('2d');
      pen.font = '600 44px system-ui, "DejaVu Sans", sans-serif';
      pen.textAlign = 'center';
      pen.textBaseline = 'middle';
      pen.lineWidth = 8;
      pen.strokeStyle = '#ffffffe0';
      pen.strokeText(text, 128, 32);
      pen.fillStyle = color;
      pen.fillText(text, 128, 32);
      const map = new T.CanvasTexture(sheet);
      map.colorSpace = 'srgb';
      const sprite = new T.Sprite(new T.SpriteMaterial({ map, depthTest: false, sizeAttenuation: false }));
      sprite.scale.set(4 * size, size, 1);
      sprite.position.set(...at);
      sprite.renderOrder = 20;
      parent.add(sprite);
      return sprite;
    }
    function addFrame(parent, name, size, at = [0, 0, -0.3 * size]) {
      [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, k) => {
        const bar = rod(parent, 0.032 * size, new T.MeshBasicMaterial({ color: COLORS.axes[k] }), 8);
        span(bar, new T.Vector3(), vector(axis).multiplyScalar(size));
      });
      if (name) addLabel(parent, name, at, COLORS.ink, 0.032);
    }

    // Vehicles: the equal homogeneous box, or a mesh.
    const vehicles = [], walls = [], names = [], adapted = []; // adapted: they move behind an adapter
    function addVehicle(parent, name) {
      const vehicle = geometry.vehicles[name], holder = group(parent);
      vehicles.push(holder);
      if (has(`pose.vehicle.${name}`)) adapted.push([holder, `vehicle.${name}`]);
      if (vehicle.hull) addHull(group(group(holder, vehicle.pose), vehicle.hull.pose), vehicle.hull.profiles, name);
      if (geometry.meshes.some(([of]) => of === name)) {
        addMeshes(group(holder, vehicle.pose), name, solid(COLORS[name], { transparent: true, opacity: 0.55 }));
        names.push(addLabel(holder, name, vehicle.pose.p, COLORS[name], 0.04));
        return;
      }
      addBox(holder, vehicle.box, name);
      names.push(addLabel(holder, name, vehicle.box.pose.p, COLORS[name], 0.04));
    }
    function addMeshes(parent, name, material) {
      const unpack = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
      for (const [of, packed] of geometry.meshes) {
        if (of !== name) continue;
        const shape = new T.BufferGeometry();
        shape.setAttribute('position', new T.BufferAttribute(new Float32Array(unpack(packed.points)), 3));
        shape.setIndex(new T.BufferAttribute(new Uint32Array(unpack(packed.triangles)), 1));
        shape.computeVertexNormals();
        parent.add(new T.Mesh(shape, material));
      }
    }
    function addBox(holder, shape, name) {
      const box = new T.BoxGeometry(...shape.size.map((x) => Math.max(x, 0.02 * extent)));
      const inside = group(holder, shape.pose);
      inside.add(new T.Mesh(box, veil(name)));
      inside.add(new T.LineSegments(new T.EdgesGeometry(box), new T.LineBasicMaterial({ color: COLORS[name] })));
    }

    /** Closed outlines of (x, r) turned about x: a veil, and lines along it. */
    function addHull(parent, profiles, name) {
      addRevolution(parent, profiles, veil(name));
      const material = new T.LineBasicMaterial({ color: COLORS[name], transparent: true, opacity: 0.6 });
      for (const profile of profiles) {
        for (let k = 0; k < 8; k++) {
          const points = profile.map(([x, r]) => new T.Vector3(x, r * Math.cos(k * Math.PI / 4), r * Math.sin(k * Math.PI / 4)));
          parent.add(new T.Line(new T.BufferGeometry().setFromPoints(points), material));
        }
      }
    }
    function veil(name) {
      const faces = new T.MeshLambertMaterial({ color: COLORS[name], transparent: true, opacity: 0.13, depthWrite: false, side: T.DoubleSide });
      walls.push(faces);
      return faces;
    }

    // Surfaces: rings, petals and other cores with their rounding, as the contact computes them.
    /** Closed outlines of (x, r) turned about x. */
    function addRevolution(parent, profiles, material) {
      for (const profile of profiles) {
        const mesh = new T.Mesh(new T.LatheGeometry(profile.map(([x, r]) => new T.Vector2(r, x)), 96), material);
        mesh.rotation.z = -Math.PI / 2; // y of the lathe becomes x
        parent.add(mesh);
      }
    }
    function addRing(parent, r, color) {
      addRevolution(parent, r.body.profiles, solid(color));
      return r.petals.map((petal) => addPetal(parent, petal.map(vector), r.petal_rounding, color));
    }
    function addCores(parent, cores, color) {
      const material = solid(color), glass = solid(color, { transparent: true, opacity: 0.4, depthWrite: false });
      for (const core of cores) {
        const holder = group(parent, core.pose);
        if (core.kind === 'revolution') addRevolution(holder, core.profiles, glass); // what it holds shows
        else if (core.kind === 'plate') addPetal(holder, core.points.map(vector), core.rounding, color);
        else {
          const points = core.points.map(vector);
          points.forEach((point) => ball(holder, point, core.rounding, material));
          if (points.length > 1) span(rod(holder, core.rounding, material), ...points);
        }
      }
    }
    function addPetal(parent, corners, rounding, color) {
      const material = solid(color);
      const normal = corners[1].clone().sub(corners[0]).cross(corners[3].clone().sub(corners[0])).normalize();
      for (const side of [-1, 1]) {
        const shape = new T.BufferGeometry();
        const points = corners.flatMap((c) => c.clone().addScaledVector(normal, side * rounding).toArray());
        shape.setAttribute('position', new T.BufferAttribute(new Float32Array(points), 3));
        shape.setIndex([0, 1, 2, 0, 2, 3]);
        shape.computeVertexNormals();
        parent.add(new T.Mesh(shape, material));
      }
      corners.forEach((corner, k) => {
        span(rod(parent, rounding, material, 16), corner, corners[(k + 1) % 4]);
        ball(parent, corner, rounding, material);
      });
      const middle = corners.reduce((sum, c) => sum.add(c), new T.Vector3()).multiplyScalar(0.25);
      if (normal.y * middle.y + normal.z * middle.z < 0) normal.negate(); // outwards
      return { material, middle, normal, color: new T.Color(color) };
    }

    /** A length of 1, 2, 4 or 8 in its first digit, at most this one. */
    function floorLength(length) {
      const unit = 10 ** Math.floor(Math.log10(length));
      return Number((unit * [8, 4, 2, 1].find((digit) => digit * unit <= length * (1 + 1e-9))).toPrecision(1));
    }
    const sayLength = (x) => (x < 0.1 ? `${Number((1e3 * x).toPrecision(3))} mm` : `${x} m`);
    function addArrow(parent, color, radius) {
      const material = new T.MeshBasicMaterial({ color, depthTest: false, transparent: true, opacity: 0.92 });
      const shaft = rod(parent, radius, material, 12);
      const head = new T.Mesh(new T.ConeGeometry(2.6 * radius, 7 * radius, 16), material);
      parent.add(head);
      shaft.renderOrder = head.renderOrder = 10;
      return (from, way) => {
        const length = way.length();
        shaft.visible = head.visible = length > 0.005 * extent;
        if (!shaft.visible) return;
        const along = way.clone().divideScalar(length), tip = Math.min(7 * radius, 0.6 * length);
        head.scale.setScalar(tip / (7 * radius));
        span(shaft, from, from.clone().addScaledVector(along, length - tip));
        head.position.copy(from).addScaledVector(along, length - tip / 2);
        head.quaternion.setFromUnitVectors(UP, along);
      };
    }

    const base = group(world), ring = group(world), target = group(world);
    const mount = group(world); // B, where the mechanism stands on the chaser
    mount.position.copy(vector(geometry.base.p));
    mount.quaternion.copy(quaternion(geometry.base.q));
    const captureBody = group(world);
    /** Draw the active cores of a body; those without one are in axes of G. */
    const addActive = (parent, body) => addCores(parent, (geometry.cores?.active || []).filter((core) => core.body === body), COLORS.active);
    addMeshes(mount, 'base', solid(COLORS.rod));
    addFrame(base, 'A', 0.3 * extent, [-0.08 * extent, 0, -0.1 * extent]);
    if ('chaser' in geometry.vehicles) addVehicle(base, 'chaser');
    for (const part of Object.values(geometry.interface)) addCores(base, part, COLORS.rod);
    let petals = [];
    if (hasRing) {
      addFrame(ring, geometry.capture_body === 'base' ? '' : 'G', 0.22 * extent, [-0.08 * extent, 0, 0.1 * extent]);
      if (geometry.ring) petals = addRing(ring, geometry.ring, COLORS.active);
      addActive(ring);
      addActive(captureBody, geometry.capture_body);
      if (geometry.capture_body !== 'base') addMeshes(captureBody, geometry.capture_body, solid(COLORS.active));
    } else ring.visible = false;
    if (hasTarget) {
      addFrame(target, 'P', 0.3 * extent, [0.11 * extent, 0, -0.1 * extent]);
      addVehicle(target, 'target');
      addCores(target, geometry.interface.faces || [], COLORS.passive);
      if (geometry.ring) addRing(group(target, geometry.ring.passive.pose), geometry.ring.passive, COLORS.passive);
      if (geometry.cores) addCores(target, geometry.cores.passive, COLORS.passive);
    } else target.visible = false;
    if (!geometry.ring && !geometry.cores) { // interfaces or bodies without a surface that could be drawn
      const radius = ringRadius();
      const outline = (parent, color) => {
        const mesh = new T.Mesh(new T.TorusGeometry(radius, 0.015 * extent, 10, 72), solid(color));
        if (hasTarget) mesh.rotation.y = Math.PI / 2;
        parent.add(mesh);
      };
      if (hasRing) outline(ring, COLORS.active);
      if (hasTarget) outline(target, COLORS.passive);
    }
    function ringRadius() {
      const radii = geometry.legs.map((leg) => Math.hypot(...leg.closing_point));
      return radii.length ? Math.max(...radii) : extent;
    }
    let absorber = null;
    if (geometry.contact === 'absorber' && hasTarget) absorber = rod(world, 0.025 * extent, solid(COLORS.leg));

    // Parts of vehicles.
    const parts = geometry.parts.map((part, i) => ({ part, pose: `part[${i + 1}]` })).filter(({ pose }) => has(`pose.${pose}`));
    for (const made of parts) {
      made.holder = group(world);
      vehicles.push(made.holder);
      addBox(made.holder, made.part.box, made.part.vehicle);
      names.push(addLabel(made.holder, made.part.name, made.part.box.pose.p, COLORS[made.part.vehicle], 0.03));
    }

    const bodies = {};
    for (const body of geometry.bodies) {
      if (!has(`pose.body.${body.name}`)) continue;
      const made = group(world), isOfLeg = geometry.legs.some((leg) => leg.bodies?.includes(body.name));
      const line = isOfLeg ? null : rod(world, 0.015 * extent, solid(COLORS.soft));
      if (!isOfLeg && body.is_named) addFrame(made, body.name, 0.15 * extent);
      if (!isOfLeg) for (const end of body.ends) span(rod(made, 0.015 * extent, solid(COLORS.soft)), new T.Vector3(), vector(end));
      addActive(made, body.name);
      addMeshes(made, body.name, solid(COLORS.rod));
      bodies[body.name] = { made, line, parent: body.parent };
    }
    const holderOf = (name) => (name === 'base' ? mount : name === geometry.capture_body ? captureBody : bodies[name]?.made);
    const isPlaced = (name) => name === 'base' || (name === geometry.capture_body ? hasRing : name in bodies);

    /** Pin of a crank for a tip, both from the root point: two sides of a triangle, seen along the axis. */
    function findPin(crank, tip) {
      const axis = vector(crank.axis), arm = vector(crank.pin).length(), height = tip.dot(axis);
      const flat = tip.clone().addScaledVector(axis, -height), reach = flat.length();
      const along = (reach ** 2 + arm ** 2 - crank.rod ** 2 + height ** 2) / (2 * reach);
      const across = crank.side * Math.sqrt(Math.max(0, arm ** 2 - along ** 2));
      return axis.clone().cross(flat).multiplyScalar(across / reach).addScaledVector(flat, along / reach);
    }
    /** Travel of a crank pin from home. */
    function findTravel(crank, pin) {
      const home = vector(crank.pin);
      return home.length() * Math.atan2(home.clone().cross(pin).dot(vector(crank.axis)), home.dot(pin));
    }

    // Legs: cylinder at the root, rod at the closing body; both ends are joint points of the mechanism.
    const legs = [];
    geometry.legs.forEach((leg) => {
      if (!isPlaced(leg.root) || !isPlaced(leg.closing)) return;
      const home = leg.length || vector(leg.root_point).distanceTo(vector(leg.closing_point));
      const length = leg.crank ? '' : `leg[${leg.number}].length`;
      const thick = 0.025 * extent * Math.min(1.5, Math.max(0.5, home / extent)), material = solid(COLORS.rod);
      const made = { leg, force: `leg[${leg.number}].force`, length, home, material, cylinder: rod(world, thick, solid(COLORS.leg)), rod: rod(world, 0.6 * thick, material) };
      made.joints = [ball(world, new T.Vector3(), 1.4 * thick, solid(COLORS.ink)), ball(world, new T.Vector3(), 1.2 * thick, solid(COLORS.ink))];
      legs.push(made);
    });

    // Ghosts: ring and target of the kept recording, as glass.
    const glass = new T.MeshBasicMaterial({ color: COLORS.soft, transparent: true, opacity: 0.18, depthWrite: false, side: T.DoubleSide });
    const ghosts = { ring, target };
    for (const [name, holder] of Object.entries(ghosts)) {
      const ghost = ghosts[name] = holder.clone();
      ghost.traverse((object) => {
        if (object.isSprite || object.isLine || walls.includes(object.material)) object.visible = false;
        else if (object.isMesh) object.material = glass;
      });
      world.add(ghost);
    }

    // Latches: hook on G, striker on P, in the colour of the state.
    const marks = latches.map((_, k) => {
      const material = new T.MeshLambertMaterial({ color: COLORS.latch[0], emissive: COLORS.latch[0], emissiveIntensity: 0.25 });
      const [hook] = geometry.hooks[k].points, size = geometry.hooks[k].rounding;
      if (hasRing) ball(ring, vector(hook), size, material);
      if (hasTarget) ball(target, vector(geometry.latches.strikers[k]), 0.8 * size, material);
      return material;
    });

    const ARROW = floorLength(extent);
    const triple = (name, i) => new T.Vector3(value(`${name}[1]`, i), value(`${name}[2]`, i), value(`${name}[3]`, i));
    const peak = (name) => {
      let most = 0;
      if (has(`${name}[1]`)) for (let i = 0; i <= last; i++) most = Math.max(most, triple(name, i).length());
      return orNone(most);
    };
    const most = {};
    const arrows = {
      force: addArrow(target, COLORS.force, 0.018 * extent),
      torque: addArrow(target, COLORS.torque, 0.011 * extent),
      petals: petals.map(() => addArrow(ring, COLORS.petal, 0.0125 * extent)),
    };
    const round = (x) => Number(x.toPrecision(3));
    /** Find the scales of a recording: largest loads, shortest legs. */
    function measure() {
      Object.assign(most, { force: peak('capture.force'), torque: peak('capture.torque'), petal: largest(petalForces), leg: largest(legForces) });
      for (const made of legs) made.shortest = (columns[made.length] || [made.home]).reduce((a, x) => Math.min(a, x), made.leg.min_length || Infinity);
      $('scale').textContent = [
        most.force && `force ${sayLength(ARROW)}: ${round(most.force)} N`,
        most.torque && `moment ${sayLength(ARROW)}: ${round(most.torque)} N m`,
      ].filter(Boolean).join(', ');
      $('scale').hidden = !$('scale').textContent;
    }

    const state = before?.state || { held: hasTarget ? 'target' : 'chaser', camera: '', follow: null };
    const inverse = new T.Matrix4();

    /** Put everything where it is at t. */
    function update(t) {
      const i = findSample(t);
      place(ring, findPose('ring', t));
      place(target, findPose('target', t));
      for (const [name, ghost] of Object.entries(ghosts)) {
        ghost.visible = Boolean(kept && kept[`pose.${name}`]);
        if (ghost.visible) place(ghost, findPose(name, t, kept));
      }
      for (const [holder, pose] of adapted) place(holder, findPose(pose, t));
      for (const { holder, pose } of parts) place(holder, findPose(pose, t));
      const inG = geometry.capture_body_in_G;
      captureBody.quaternion.copy(ring.quaternion).multiply(quaternion(inG.q));
      captureBody.position.copy(vector(inG.p)).applyQuaternion(ring.quaternion).add(ring.position);
      for (const [name, body] of Object.entries(bodies)) {
        place(body.made, findPose(`body.${name}`, t));
      }
      for (const body of Object.values(bodies)) {
        const parent = body.line && holderOf(body.parent);
        if (parent) span(body.line, parent.position, body.made.position);
      }
      for (const made of legs) {
        const ends = ['root', 'closing'].map((end) => {
          const holder = holderOf(made.leg[end]);
          return vector(made.leg[`${end}_point`]).applyQuaternion(holder.quaternion).add(holder.position);
        });
        const along = ends[1].clone().sub(ends[0]), length = along.length();
        made.drawn = length;
        if (made.leg.crank) {
          const holder = holderOf(made.leg.root);
          const tip = along.applyQuaternion(holder.quaternion.clone().invert());
          const pin = findPin(made.leg.crank, tip);
          made.drawn = findTravel(made.leg.crank, pin);
          pin.applyQuaternion(holder.quaternion).add(ends[0]);
          span(made.cylinder, ends[0], pin);
          span(made.rod, pin, ends[1]);
          made.joints.forEach((joint, k) => joint.position.copy(k ? pin : ends[0]));
          continue;
        }
        along.divideScalar(length);
        span(made.cylinder, ends[0], ends[0].clone().addScaledVector(along, Math.min(0.85 * made.shortest, 0.95 * length)));
        span(made.rod, ends[1].clone().addScaledVector(along, -Math.min(0.8 * made.shortest, length)), ends[1]);
        made.joints.forEach((joint, k) => joint.position.copy(ends[k]));
      }
      legs.forEach((made) => {
        const force = value(made.force, i);
        if (!(most.leg > 0 && has(made.force))) return;
        const part = Math.min(1, Math.abs(force) / most.leg);
        made.material.color.set(COLORS.rod).lerp(new T.Color(force > 0 ? COLORS.push : COLORS.pull), part);
      });
      marks.forEach((material, k) => {
        const color = COLORS.latch[value(latches[k], i) - 1] || COLORS.latch[0];
        material.color.set(color);
        material.emissive.set(color);
      });
      petals.forEach((petal, k) => {
        const force = value(petalForces[k], i) || 0, part = most.petal > 0 ? force / most.petal : 0;
        petal.material.color.copy(petal.color).lerp(new T.Color(COLORS.load), Math.sqrt(part));
        const way = petal.normal.clone().multiplyScalar(most.force > 0 ? -ARROW * force / most.force : 0);
        arrows.petals[k](petal.middle.clone().sub(way), way);
      });
      const origin = new T.Vector3();
      for (const name of ['force', 'torque']) {
        const way = most[name] > 0 ? triple(`capture.${name}`, i).multiplyScalar(ARROW / most[name]) : new T.Vector3();
        arrows[name](origin, way);
      }
      if (absorber) span(absorber, base.position, target.position);
      world.matrix.identity();
      if (state.held === 'target' && hasTarget) {
        target.updateMatrix();
        world.matrix.copy(inverse.copy(target.matrix).invert());
      }
      world.matrixWorldNeedsUpdate = true;
      if (state.follow) {
        const now = findMiddle('ring');
        const way = now.clone().sub(state.follow);
        camera.position.add(way);
        controls.target.add(way);
        state.follow = now;
        controls.update();
      }
    }

    /** Where to look: the ring, or the interfaces; axes of the scene. */
    function listPoints(what) {
      const points = [];
      if (hasRing) points.push(ring.position.clone());
      if (what !== 'ring') points.push(new T.Vector3());
      if (what !== 'ring' && hasTarget) points.push(target.position.clone());
      if (!points.length) points.push(new T.Vector3());
      return points.map((p) => p.applyMatrix4(world.matrix));
    }
    function findMiddle(what) {
      const points = listPoints(what);
      return points.reduce((sum, p) => sum.add(p), new T.Vector3()).divideScalar(points.length);
    }
    const DIRECTIONS = {
      oblique: [-0.62, -1, 0.62], side: [0, -1, 0.0001], top: [0, -0.0001, 1], front: [1, -0.0001, 0], axis: [-1, -0.0001, 0],
      ring: [0.75, -0.8, 0.55], vehicles: [-0.25, -1, 0.35],
    };
    function look(name) {
      const direction = vector(DIRECTIONS[name]).normalize(), middle = findMiddle(name);
      let radius = (hasTarget ? 1.15 : 1.05) * extent;
      if (name === 'ring') radius = 0.95 * extent;
      else for (const p of listPoints(name)) radius = Math.max(radius, p.distanceTo(middle) + 0.6 * extent); // far apart
      if (name === 'vehicles') {
        const bounds = new T.Box3();
        world.updateMatrixWorld(true);
        vehicles.forEach((holder) => holder.children.forEach((c) => c.isSprite || bounds.expandByObject(c)));
        if (!bounds.isEmpty()) {
          bounds.getCenter(middle);
          radius = 0.5 * bounds.getSize(new T.Vector3()).length();
        }
      }
      const half = Math.tan((camera.fov * Math.PI) / 360) * Math.min(1, camera.aspect);
      controls.target.copy(middle);
      camera.position.copy(middle).addScaledVector(direction, radius / half);
      controls.update();
      state.camera = name;
      state.follow = name === 'ring' ? findMiddle('ring') : null;
    }
    function resize() {
      const { clientWidth: w, clientHeight: h } = space;
      if (!w || !h) return;
      renderer.setSize(w, h, false);
      camera.aspect = w / h;
      camera.updateProjectionMatrix();
    }
    /** Turn the camera about what it looks at [rad], or go nearer by a factor. */
    function turn(right, up, nearer = 1) {
      const arm = camera.position.clone().sub(controls.target);
      const polar = Math.acos(Math.max(-1, Math.min(1, arm.z / arm.length())));
      const azimuth = Math.atan2(arm.y, arm.x) - right, tilt = Math.min(3.1, Math.max(0.04, polar - up));
      const length = Math.min(controls.maxDistance, Math.max(controls.minDistance, arm.length() / nearer));
      arm.set(Math.sin(tilt) * Math.cos(azimuth), Math.sin(tilt) * Math.sin(azimuth), Math.cos(tilt));
      camera.position.copy(controls.target).addScaledVector(arm, length);
      controls.update();
    }
    return {
      update, look, resize, turn, measure, renderer, camera, state, controls, legs, most,
      dispose: () => scene.traverse((object) => {
        object.geometry?.dispose();
        object.material?.map?.dispose();
        object.material?.dispose();
      }),
      draw: () => { // boxes fade from near, where they would hide the mechanism
        const far = Math.min(1, Math.max(0, camera.position.distanceTo(controls.target) / (12 * extent) - 0.7));
        for (const faces of walls) Object.assign(faces, { opacity: 0.18 * far, visible: far > 0 }); // a veil costs half of a picture
        for (const name of names) name.visible = far > 0;
        const began = performance.now();
        renderer.render(scene, camera);
        if (!state.isTimed) return;
        context.readPixels(0, 0, 1, 1, context.RGBA, context.UNSIGNED_BYTE, new Uint8Array(4)); // waits for the picture
        Object.assign(state, { isTimed: false, isSlow: performance.now() - began > SLOW });
      },
      /** Draw half as fine while the docking changes, if a picture takes long; it is timed when that rests. */
      setMoving: (on) => {
        const ratio = findFineness() * (on && state.isSlow ? 0.5 : 1);
        if (renderer.getPixelRatio() !== ratio) renderer.setPixelRatio(ratio);
        state.isTimed = !on;
      },
      setVehicles: (on) => vehicles.forEach((holder) => { holder.visible = on; }),
      matrix: (name) => {
        const holder = { ring, target, chaser: base }[name] || bodies[name].made;
        holder.updateMatrix();
        return holder.matrix.toArray();
      },
    };
  }

  // ------------------------------------------------------------------ curves

  /** A number for a narrow margin. */
  function nice(x) {
    const size = Math.abs(x);
    if (size >= 1000) return x.toFixed(0);
    const short = Number(x.toPrecision(3));
    return size > 0 && size < 1e-3 ? short.toExponential() : String(short);
  }
  const name2 = (text) => text.replace(/^.*\[(\d+)\].*$/, '$1');
  const figures = [];
  const LEFT = 52, RIGHT = 38; // margins of a curve, for the labels of the ordinate [px]
  /** The dashes of a curve, as the background of its key. */
  function makeDashes({ color, dashes }) {
    const stops = [];
    let at = 0;
    dashes.forEach((length, k) => {
      const shown = k % 2 ? 'transparent' : color;
      stops.push(`${shown} ${at}px ${at + length}px`);
      at += length;
    });
    return `repeating-linear-gradient(90deg, ${stops.join(', ')})`;
  }
  /** Add a sheet with a heading, and the line that shows the time. */
  function addSheet(title) {
    const make = (tag) => document.createElement(tag);
    const outer = make('figure'), caption = make('figcaption'), heading = make('b'), sheet = make('div'), canvas = make('canvas'), cursor = make('i');
    heading.textContent = title;
    canvas.setAttribute('role', 'img');
    canvas.setAttribute('aria-label', `${title} over time`);
    caption.append(heading);
    sheet.append(canvas, cursor);
    outer.append(caption, sheet);
    $('curves').append(outer);
    addPointer(canvas);
    figures.push({ canvas, caption, cursor, width: 0 });
    return figures[figures.length - 1];
  }
  function addFigure(title, series, more = {}) {
    const found = series.filter((s) => has(s.column));
    if (!found.length) return;
    const figure = addSheet(title);
    found.forEach((s, k) => {
      s.color = s.color || COLORS.lines[k % COLORS.lines.length];
      s.dashes = COLORS.dashes[k % COLORS.dashes.length];
      s.factor = s.factor || 1;
      const entry = document.createElement('span'), key = document.createElement('i');
      key.style.background = s.dashes.length ? makeDashes(s) : s.color;
      s.text = document.createTextNode('');
      entry.append(key, s.text);
      figure.caption.append(entry);
    });
    Object.assign(figure, { series: found, ...more });
  }
  function addStrip(title, column, colors, names) {
    if (!has(column)) return;
    const text = document.createElement('span'), figure = addSheet(title);
    figure.canvas.className = 'strip';
    figure.caption.append(text);
    Object.assign(figure, { strip: column, colors, names, text });
  }
  function addPointer(canvas) {
    const go = (event) => {
      const box = canvas.getBoundingClientRect();
      pause();
      const part = (event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT);
      setTime(range[0] + (range[1] - range[0]) * Math.min(1, Math.max(0, part)));
    };
    canvas.addEventListener('pointerdown', (event) => { canvas.setPointerCapture(event.pointerId); go(event); });
    canvas.addEventListener('pointermove', (event) => { if (event.buttons) go(event); });
  }

  function makeFigures() {
    figures.length = 0;
    $('curves').replaceChildren();
    addStrip('phase', 'phase', COLORS.phase, meta.phases);
    const rated = meta.rated, allRated = LOAD_NAMES.every((n) => n in rated);
    addFigure(allRated ? 'loads, part of rated' : 'loads', LOAD_NAMES.map((n) => ({
      column: `capture.${n}`, name: n, unit: meta.loads[n], factor: allRated ? 100 / rated[n] : 1,
      say: (x) => `${n} ${nice(x)}${n in rated ? ` of ${rated[n]}` : ''} ${meta.loads[n]}`,
    })), { unit: allRated ? '%' : 'N', levels: allRated ? [[100, 'rated']] : [] });
    latches.forEach((column, k) => addStrip(`latch ${k + 1}`, column, COLORS.latch, meta.latch_states));
    addFigure('latch openings', list('latch[#].opening').map((column) => ({
      column, factor: 1e3, say: (x) => `${name2(column)}: ${nice(1e3 * x)} mm`,
    })), { unit: 'mm', levels: geometry.latches ? [[1e3 * geometry.latches.range, 'pawl'], [1e3 * geometry.latches.catch, 'catch']] : [] });
    addFigure('P relative to A', [
      { column: 'relative.axial', factor: 1e3, say: (x) => `axial ${nice(1e3 * x)} mm` },
      { column: 'relative.lateral', factor: 1e3, say: (x) => `lateral ${nice(1e3 * x)} mm` },
    ], { unit: 'mm', levels: [] });
    addFigure('misalignment', [
      { column: 'relative.pitch_yaw', factor: 180 / Math.PI, say: (x) => `pitch/yaw ${(180 / Math.PI * x).toFixed(2)}\u00b0` },
      { column: 'relative.roll', factor: 180 / Math.PI, say: (x) => `roll ${(180 / Math.PI * x).toFixed(2)}\u00b0` },
    ], { unit: '\u00b0', levels: [] });
    addFigure('energy', ['kinetic', 'potential', 'dissipated'].map((n) => ({ column: `energy.${n}`, say: (x) => `${n} ${nice(x)} J` })), { unit: 'J', levels: [] });
    addFigure('surface forces (size)', surfaceForces.map((column) => ({ column, say: (x) => `${name2(column)}: ${nice(x)} N` })), { unit: 'N', levels: [] });
    addFigure('petal forces (size)', petalForces.map((column) => ({ column, say: (x) => `${name2(column)}: ${nice(x)} N` })), { unit: 'N', levels: [] });
    addFigure('leg forces, + pushes apart', legForces.map((column) => ({ column, say: (x) => `${name2(column)}: ${nice(x)} N` })), { unit: 'N', levels: [] });
    if (!legForces.length) addFigure('leg lengths', list('leg[#].length').map((column) => ({ column, factor: 1e3, say: (x) => `${name2(column)}: ${nice(1e3 * x)} mm` })), { unit: 'mm', levels: [] });
  }

  let range = [times[0], times[last]], chosenSpan = '';

  /** Lay a path through samples: of every pixel the first, the lowest, the highest and the last, in the order of their times. */
  function trace(pen, times, column, from, to, x, y) {
    for (let i = from, j = from; i <= to; i = j) {
      const pixel = Math.floor(x(times[i]));
      let low = i, high = i;
      for (; j <= to && Math.floor(x(times[j])) === pixel; j++) {
        if (column[j] < column[low]) low = j;
        if (column[j] > column[high]) high = j;
      }
      for (const k of new Set([i, Math.min(low, high), Math.max(low, high), j - 1])) pen.lineTo(x(times[k]), y(column[k]));
    }
  }
  /** Draw the curves that are old and in the window; first all is measured, then all is drawn. */
  function drawCurves(everywhere) {
    if (curvesWanted) for (const figure of figures) figure.isOld = true;
    curvesWanted = isScrolled = false;
    const found = figures.filter((figure) => figure.isOld).map((figure) => [figure, figure.canvas.getBoundingClientRect(), figure.caption.offsetHeight]);
    for (const [figure, box, height] of found) {
      if (!box.width || (!everywhere && (box.bottom < 0 || box.top > window.innerHeight))) continue;
      const { style } = figure.caption; // it may grow with its numbers, and never shrinks again
      style.minHeight = `${Math.max(parseFloat(style.minHeight) || 0, height)}px`;
      drawFigure(figure, box.width, box.height);
      figure.isOld = false;
    }
  }
  /** Draw a curve or strip afresh. */
  function drawFigure(figure, w, h) {
    const { canvas } = figure, ratio = Math.min(window.devicePixelRatio || 1, 2);
    figure.width = w;
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
    const pen = canvas.getContext('2d');
    pen.scale(ratio, ratio);
    pen.fillStyle = COLORS.paper;
    pen.fillRect(0, 0, w, h);
    const [ta, tb] = range, right = w - RIGHT, x = (t) => LEFT + ((t - ta) / (tb - ta || 1)) * (right - LEFT);
    const within = (of) => [findSample(ta, of), Math.min(of.time.length - 1, findSample(tb, of) + 1)];
    const [i0, i1] = within(columns);
    if (figure.strip) {
      const column = columns[figure.strip];
      for (let i = i0; i <= i1;) {
        let j = i;
        while (j <= i1 && column[j] === column[i]) j++;
        pen.fillStyle = figure.colors[column[i] - 1] || '#eee';
        const from = Math.max(LEFT, x(times[i]));
        pen.fillRect(from, 2, Math.min(right, x(times[Math.min(j, last)])) - from + 0.5, h - 4);
        i = j;
      }
    } else {
      let low = Infinity, high = -Infinity;
      const shown = kept ? [kept, columns] : [columns];
      for (const of of shown) {
        const [from, to] = within(of);
        for (const { column, factor } of figure.series) {
          for (let i = from; i <= to; i++) {
            const y = (of[column] ? of[column][i] : NaN) * factor;
            if (y < low) low = y;
            if (y > high) high = y;
          }
        }
      }
      for (const [level] of figure.levels) if (level < 2 * high && level > 2 * low - 1) { low = Math.min(low, level); high = Math.max(high, level); }
      if (high - low < 1e-9) { high += 1; low -= high > 1 ? 1 : 0; }
      const margin = 0.07 * (high - low);
      low -= margin;
      high += margin;
      const y = (v) => h - ((v - low) / (high - low)) * h;
      pen.strokeStyle = '#dfe5eb';
      pen.lineWidth = 1;
      pen.strokeRect(LEFT - 0.5, 0.5, right - LEFT + 1, h - 1);
      pen.font = '11px system-ui, "DejaVu Sans", sans-serif';
      if (low < 0 && high > 0) { pen.beginPath(); pen.moveTo(LEFT, y(0)); pen.lineTo(right, y(0)); pen.stroke(); }
      const rows = []; // base lines of the names of levels, one above the other
      for (const [level, text] of [...figure.levels].sort((a, b) => a[0] - b[0])) {
        if (level < low || level > high) continue;
        pen.strokeStyle = COLORS.faint;
        pen.setLineDash([5, 4]);
        pen.beginPath();
        pen.moveTo(LEFT, y(level));
        pen.lineTo(right, y(level));
        pen.stroke();
        pen.setLineDash([]);
        pen.fillStyle = COLORS.soft;
        let row = Math.min(h - 3, Math.max(11, y(level) + 4));
        while (rows.some((other) => Math.abs(other - row) < 11)) row -= 1;
        rows.push(row);
        pen.fillText(text, right + 4, row);
      }
      pen.save();
      pen.beginPath();
      pen.rect(LEFT, 0, right - LEFT, h);
      pen.clip();
      for (const of of shown) { // the kept one first, pale
        const [from, to] = within(of);
        pen.globalAlpha = of === columns ? 1 : 0.4;
        for (const { column, color, dashes, factor } of figure.series) {
          if (!of[column]) continue;
          pen.strokeStyle = color;
          pen.lineWidth = of === columns ? 1.3 : 2.6;
          pen.setLineDash(dashes);
          pen.beginPath();
          trace(pen, of.time, of[column], from, to, x, (v) => y(v * factor));
          pen.stroke();
        }
      }
      pen.globalAlpha = 1;
      pen.restore();
      pen.fillStyle = COLORS.soft;
      pen.textAlign = 'right';
      pen.fillText(nice(high - margin), LEFT - 4, 11);
      pen.fillText(nice(low + margin), LEFT - 4, h - 4);
      pen.fillText(figure.unit, LEFT - 4, h / 2 + 4);
      pen.textAlign = 'left';
    }
    for (const event of events) {
      const isLimit = event.key.startsWith('limit');
      if (!(isLimit || ['contact', 'capture'].includes(event.key)) || event.time < ta || event.time > tb) continue;
      pen.strokeStyle = isLimit ? COLORS.limit : COLORS.soft;
      pen.setLineDash(isLimit ? [6, 3] : [2, 3]);
      pen.beginPath();
      pen.moveTo(x(event.time), 0);
      pen.lineTo(x(event.time), h);
      pen.stroke();
      pen.setLineDash([]);
    }
  }
  function drawCursors(i) {
    const part = (time - range[0]) / (range[1] - range[0] || 1), isInside = part > -1e-9 && part < 1 + 1e-9;
    for (const figure of figures) {
      figure.cursor.hidden = !isInside || !figure.width;
      figure.cursor.style.transform = `translateX(${LEFT + part * (figure.width - LEFT - RIGHT) - 0.75}px)`;
      if (figure.strip) figure.text.textContent = figure.names[columns[figure.strip][i] - 1] || '';
      else for (const s of figure.series) s.text.data = s.say(columns[s.column][i]);
    }
  }

  // ------------------------------------------------------------------ time

  let time = times[0], playing = false, before = 0, wanted = true, curvesWanted = true, isScrolled = false;
  const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10];
  const clampTime = (t) => Math.min(times[last], Math.max(times[0], t));

  function setTime(t) {
    time = clampTime(t);
    wanted = true;
  }
  const goSample = (i) => { pause(); setTime(times[Math.min(last, Math.max(0, i))]); };
  function step(n) {
    const i = findSample(time);
    goSample(n < 0 && time > times[i] + 1e-12 ? i + n + 1 : i + n);
  }
  function play() {
    if (time >= times[last]) time = times[0];
    playing = true;
    before = performance.now();
    showPlaying();
  }
  function pause() { playing = false; showPlaying(); }
  function showPlaying() {
    $('play').textContent = playing ? 'pause' : 'play';
    wanted = true;
  }
  function goEvent(direction) {
    const i = findSample(time);
    const found = direction > 0 ? events.find((e) => e.index > i) : events.filter((e) => e.index < i).pop();
    if (found) goEventAt(found);
  }
  function goEventAt(event) {
    goSample(event.index);
    if (time < range[0] || time > range[1]) { $('span').value = 'all'; setSpan('all'); }
  }

  function describe(i) {
    const words = [];
    if (has('phase')) words.push(meta.phases[value('phase', i) - 1]);
    if (has('outcome')) {
      const outcome = meta.outcomes[value('outcome', i) - 1];
      if (outcome !== 'undecided' && outcome !== words[0]) words.push(outcome);
    }
    const held = latches.filter((n) => value(n, i) === 4).length;
    if (latches.length) words.push(`${held} of ${latches.length} latches held`);
    return words.join(', ');
  }

  function refresh() {
    const i = findSample(time), between = time > times[i] + 1e-12;
    if (view) { view.update(time); view.draw(); }
    drawCursors(i);
    $('now').textContent = [last ? `${time.toFixed(3)} s` : 'saved state', has('phase') && describe(i)].filter(Boolean).join(' \u00b7 ');
    $('clock').textContent = `${time.toFixed(3)} of ${times[last].toFixed(2)} s${between ? ' (between samples)' : ''}`;
    const slider = $('slider');
    slider.value = String(time);
    slider.setAttribute('aria-valuetext', `${time.toFixed(3)} s, ${describe(i)}`);
    for (const button of $('events').children) button.setAttribute('aria-pressed', String(!between && Number(button.dataset.index) === i));
  }
  function frame(now) {
    if (playing) {
      time = clampTime(time + ((now - before) / 1000) * SPEEDS[$('speed').selectedIndex]);
      before = now;
      wanted = true;
      if (time >= times[last]) pause();
    }
    if (curvesWanted) wanted = true;
    if (curvesWanted || isScrolled) drawCurves();
    if (wanted) { wanted = false; refresh(); }
    requestAnimationFrame(frame);
  }

  // ------------------------------------------------------------------ controls

  function addButtons(place, entries) {
    for (const [text, hint, act, index] of entries) {
      const button = document.createElement('button');
      button.type = 'button';
      button.textContent = text;
      button.title = hint;
      if (index !== undefined) button.dataset.index = index;
      button.addEventListener('click', () => act(button));
      place.append(button);
    }
  }
  const CAMERAS = [['oblique', 'oblique'], ['side', 'from the side'], ['front', 'from the target'], ['axis', 'from the chaser, along the axis'], ['ring', 'follow the ring'], ['vehicles', 'both vehicles']];
  function setCamera(name) {
    if (!view) return;
    view.look(name);
    wanted = true;
    [...$('cameras').children].forEach((button, k) => button.setAttribute('aria-pressed', String(CAMERAS[k][0] === name)));
  }
  function addOptions(select, entries, chosen) {
    for (const [key, text] of entries) select.append(new Option(text, key, key === chosen, key === chosen));
  }
  function setSpan(key) {
    const at = (k) => events.find((e) => e.key === k)?.time;
    const contact = at('contact'), capture = at('capture');
    range = [times[0], times[last]];
    if (key === 'near') range = [clampTime(contact - 0.25 * (capture - contact)), clampTime(capture + 0.5 * (capture - contact))];
    if (key === 'contact') range = [clampTime(contact - 0.1), clampTime(contact + 0.4)];
    curvesWanted = true;
  }
  function setHeld(name) {
    if (!view) return;
    view.state.held = name;
    view.state.follow = null;
    view.update(time);
    setCamera(view.state.camera || 'oblique');
  }

  if (!context) $('cameras').hidden = true;
  addOptions($('speed'), SPEEDS.map((s) => [String(s), `\u00d7 ${s}`]), '1');
  const slider = $('slider');
  slider.step = 'any';
  slider.addEventListener('input', () => { pause(); setTime(Number(slider.value)); });
  $('play').addEventListener('click', () => (playing ? pause() : play()));
  $('back').addEventListener('click', () => step(-1));
  $('next').addEventListener('click', () => step(1));
  $('span').addEventListener('change', (e) => { chosenSpan = e.target.value; setSpan(chosenSpan); });
  $('still').addEventListener('change', (e) => setHeld(e.target.value));
  $('boxes').addEventListener('change', (e) => { view?.setVehicles(e.target.checked); wanted = true; });

  /** Fill everything that belongs to one recording: words, events, marks, legend, notes. */
  function fillPage() {
    $('title').textContent = `${meta.name}: ${meta.title}`;
    $('sentence').textContent = meta.sentence;
    for (const id of ['events', 'marks', 'legend', 'notes', 'span', 'still']) $(id).replaceChildren();
    addButtons($('events'), events.map((e) => [e.text, `${e.time.toFixed(4)} s${e.part ? `, ${e.part}` : ''}`, () => goEventAt(e), e.index]));
    for (const event of [...events].sort((a, b) => b.key.startsWith('peak') - a.key.startsWith('peak'))) {
      const mark = document.createElement('span');
      mark.style.left = `${(100 * (event.time - times[0])) / (times[last] - times[0] || 1)}%`;
      const kind = event.key.replace(/_.*/, '');
      if (kind === 'start' || kind === 'end') continue;
      mark.className = kind;
      mark.title = `${event.text}, ${event.time.toFixed(4)} s`;
      mark.style.color = { contact: COLORS.contact, capture: COLORS.capture, limit: COLORS.limit }[kind] || COLORS.ink;
      $('marks').append(mark);
    }
    const spans = [['all', 'whole run']];
    if (events.some((e) => e.key === 'contact')) {
      if (events.some((e) => e.key === 'capture')) spans.push(['near', 'contact to capture']);
      spans.push(['contact', 'first 0.4 s of contact']);
    }
    chosenSpan ||= spans[1]?.[0] === 'near' ? 'near' : 'all';
    addOptions($('span'), spans, spans.some(([key]) => key === chosenSpan) ? chosenSpan : 'all');
    setSpan($('span').value);
    addOptions($('still'), hasTarget ? [['target', 'target'], ['chaser', 'chaser']] : [['chaser', 'base']], view?.state.held);
    slider.min = times[0];
    slider.max = times[last];
    if (view) fillLegend();
    fillNotes();
    document.body.classList.toggle('moment', !last); // it has no time
  }
  function addEntry(color, text) {
    const entry = document.createElement('li'), key = document.createElement('i');
    key.style.background = color;
    entry.append(key, text);
    $('legend').append(entry);
  }
  function fillLegend() {
    const thing = geometry.ring ? 'ring' : 'side';
    if (hasRing) addEntry(COLORS.active, `active ${thing} ${geometry.capture_body === 'base' ? 'A' : 'G'}, on the chaser`);
    const parts = Object.keys(geometry.interface);
    if (parts.length) addEntry(COLORS.rod, `${parts.join(', ')} of the hard dock, on the chaser`);
    if (hasTarget) addEntry(COLORS.passive, `passive ${thing} P, on the target`);
    if (view.most.force > 0) addEntry(COLORS.force, 'force on the target');
    if (view.most.torque > 0) addEntry(COLORS.torque, 'moment on the target');
    if (view.most.petal > 0) addEntry(COLORS.petal, 'petal force (size)');
    if (view.most.leg > 0) { addEntry(COLORS.push, 'leg pushes'); addEntry(COLORS.pull, 'leg pulls'); }
    if (latches.length) meta.latch_states.forEach((s, k) => latches.some((n) => columns[n].includes(k + 1)) && addEntry(COLORS.latch[k], `latch ${s}`));
  }
  function fillNotes() {
    const notes = [
      ...meta.notes,
      `${meta.samples} samples; arrow keys go from sample to sample. Between samples the motion is interpolated, everything else keeps the value before.`,
      geometry.ring || geometry.cores
        ? 'Surfaces, hooks, strikers and legs have the dimensions of the mechanism file. Diameters of legs and joints are symbols.'
        : 'The mechanism has no contact surfaces with a shape: circles stand for the interfaces. Diameters are symbols.',
      meta.fit === null ? '' : `Drawn leg lengths and latch openings differ from the recorded ones by at most ${(1e3 * meta.fit).toExponential(1)} mm.`,
      ...Object.entries(geometry.vehicles).map(([name, v]) => (v.mesh
        ? `The ${name} is a mesh that was given.`
        : `The box of the ${name} is the homogeneous one with its mass (${v.mass} kg) and inertia${v.is_cut ? ', cut in front of the docking interface' : ''}.`)),
      view && view.most.force > 0 ? 'The force arrow is the load on the target through the capture interface, in P. Of petal forces only the size is recorded: their arrows stand across the petal.' : '',
      'An event is shown at the first sample after it.',
      meta.command ? `Made by: ${meta.command}` : '',
      `dockloop ${meta.version}; drawn with three.js (MIT).`,
    ];
    for (const text of notes.filter(Boolean)) {
      const entry = document.createElement('li');
      entry.textContent = text;
      $('notes').append(entry);
    }
  }

  document.addEventListener('keydown', (event) => {
    if (event.altKey || event.metaKey || event.target.closest('select, [data-keys=own]')) return;
    const isButton = ['BUTTON', 'SUMMARY'].includes(event.target.tagName) || event.target.type === 'checkbox';
    const key = event.key;
    const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
    let done = true;
    if (event.shiftKey && key in turns) view?.turn(...turns[key]);
    else if (key === ' ' && !isButton) (playing ? pause : play)();
    else if (key === 'ArrowLeft') step(event.ctrlKey ? -10 : -1);
    else if (key === 'ArrowRight') step(event.ctrlKey ? 10 : 1);
    else if (event.ctrlKey) done = false;
    else if (key === 'Home') goSample(0);
    else if (key === 'End') goSample(last);
    else if (key === 'n') goEvent(1);
    else if (key === 'p') goEvent(-1);
    else if (key === '+' || key === '=') view?.turn(0, 0, 1.15);
    else if (key === '-') view?.turn(0, 0, 1 / 1.15);
    else if (key === '<' || key === '>') $('speed').selectedIndex = Math.min(SPEEDS.length - 1, Math.max(0, $('speed').selectedIndex + (key === '>' ? 1 : -1)));
    else if (key >= '1' && key <= String(CAMERAS.length)) setCamera(CAMERAS[Number(key) - 1][0]);
    else done = false;
    if (done) { event.preventDefault(); wanted = true; }
  });

  let shape = ''; // what decides the drawn bodies and the curves there are
  /** Show a recording, one of many in a row or not; the camera, the time and the chosen span stay. */
  function load(next, isMoving = false) {
    const isFirst = !shape;
    data = next;
    ({ meta, geometry, events } = data);
    columns = unpack(data.columns);
    times = columns.time;
    last = times.length - 1;
    findColumns();
    time = clampTime(time);
    const before = shape;
    shape = JSON.stringify([geometry, meta.rated, Object.keys(columns)]);
    if (shape !== before) {
      const old = view;
      if (context) view = makeView(old);
      old?.dispose();
      makeFigures();
      if (isFirst) $('boxes').checked = hasTarget;
      view?.setVehicles($('boxes').checked);
      view?.resize();
    }
    view?.measure();
    if (!isFirst) view?.setMoving(isMoving); // the first picture takes longer
    fillPage();
    if (isFirst) {
      CAMERAS.splice(0, CAMERAS.length, ...CAMERAS.filter(([key]) => key !== 'ring' || hasRing));
      addButtons($('cameras'), CAMERAS.map(([key, hint]) => [key, hint, () => setCamera(key)]));
      view?.update(time);
      setCamera('oblique');
      view?.controls.addEventListener('change', () => { wanted = true; });
    }
    curvesWanted = true;
  }
  $('nogl').hidden = Boolean(context);
  load(data);
  const fit = () => { view?.resize(); curvesWanted = true; };
  new ResizeObserver(fit).observe($('stage'));
  new ResizeObserver(() => { curvesWanted = true; }).observe($('curves'));
  document.addEventListener('scroll', () => { isScrolled = true; }, { capture: true, passive: true });
  window.addEventListener('beforeprint', () => drawCurves(true));
  requestAnimationFrame(frame);

  // For tests, stills and films: the page driven from outside.
  window.dockloop = {
    get data() { return data; },
    get events() { return events; },
    get time() { return time; },
    load,
    /** Lay a recording under the one that is shown, or none. */
    keep(other) {
      kept = other && unpack(other.columns);
      curvesWanted = true;
    },
    /** Show a time [s] at once; words are names of events. */
    show(t) {
      const event = events.find((e) => e.key === t || (t === 'peak' && e.first));
      if (!event && !Number.isFinite(Number(t))) throw new Error(`no event ${t}`);
      pause();
      setTime(event ? times[event.index] : Number(t));
      if (curvesWanted) drawCurves();
      wanted = false;
      refresh();
      return time;
    },
    setCamera(name) { setCamera(name); refresh(); },
    setPicture(on) { document.body.classList.toggle('picture', on); view?.resize(); },
    cameras: CAMERAS.map(([key]) => key),
    pose: (name, t) => findPose(name, t),
    drawn: (name) => view && view.matrix(name),
    legs: () => view && view.legs.map((made) => made.drawn),
    draws: () => Boolean(view),
  };
})();
