(() => {
  // The cell in three dimensions. The same projection as in figures/scene.py: the eye circles about a point of the
  // cell and keeps z upright, what is nearer is drawn larger and over what is behind. Plain SVG: it needs no WebGL,
  // follows the page's colours and prints.
  const FAR = 3, STILL = matchMedia("(prefers-reduced-motion: reduce)");
  const make = (name, attributes = {}, text = "") => {
    const one = document.createElementNS("http:" + "//www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
    one.textContent = text;
    return one;
  };
  const steps = (index) => [1, 2, 5][index % 3] * 10 ** Math.floor(index / 3);
  const index = (value) => Math.round(3 * Math.log10(value));
  const add = (a, b, by = 1) => a.map((value, k) => value + by * b[k]);
  const fixed = (value) => value.toFixed(1);

  const begin = (figure) => {
    const numbers = JSON.parse(figure.querySelector(".numbers").textContent);
    const stage = figure.querySelector(".stage"), tools = figure.querySelector(".tools");
    const says = figure.querySelector(".says"), fields = tools.elements;
    const { poses, view } = numbers;
    const svg = make("svg", { class: "live", "aria-hidden": "true" });
    const layers = ["sight", "solids", "vectors", "words"].map((name) => make("g", { class: name }));
    svg.append(...layers);
    const [sights, solids, vectors, words] = layers;
    const home = { yaw: view.yaw, pitch: view.pitch, middle: view.middle, scale: 1, x: 0, y: 0 };
    let eye = { ...home }, chosen = -1, width = 800, height = 420, asked = 0, moving = 0;

    // What is drawn: every solid and vector is one element that is moved, never made anew.
    const solid = (part, pose) => {
      const [kind, name, ...at] = part;
      const one = make("path", { class: `solid ${kind}` });
      if (pose >= 0) one.dataset.pose = pose;
      solids.append(one);
      return { one, pose, kind, name, from: at.slice(0, 3), to: at.slice(3, 6), radius: Math.max(at[6], 0.006), depth: 0 };
    };
    const shapes = [
      ...numbers.still.filter((part) => part[8] > 0).map((part) => solid(part, -1)),
      ...poses.flatMap((pose, k) => pose.parts.map((part) => solid(part, k))),
    ];
    const marks = numbers.still.filter((part) => part[8] === 0).map(([kind, name, ...at]) => {
      const one = make(kind === "tracker" ? "path" : "circle", { class: "fixed", r: 2.5 });
      const label = make("text", {}, name);
      words.append(one, label);
      return { one, label, kind, at: at.slice(0, 3) };
    });
    const trackers = marks.filter((mark) => mark.kind === "tracker");
    const arrows = poses.flatMap((pose, k) => pose.points.flatMap(([name, ...at]) =>
      ["moved", "left"].map((kind, which) => {
        const one = make("path", { class: `vector ${kind}` });
        one.dataset.pose = k;
        vectors.append(one);
        return { one, kind, pose: k, name, at: at.slice(0, 3), by: at.slice(3 + 3 * which, 6 + 3 * which), cov: at.slice(9, 15) };
      })));
    const triad = ["x", "y", "z"].map((name) => {
      const one = make("path", { class: "axis" }), label = make("text", { "text-anchor": "middle" }, name);
      words.append(one, label);
      return { one, label };
    });
    const title = make("text"), names = [], balls = [], beams = [];

    // Right and up in pixels, depth away from the eye in metres, and how much larger for being near.
    const project = (p, from = eye) => {
      const c = Math.cos(from.yaw), s = Math.sin(from.yaw), e = Math.sin(from.pitch), f = Math.cos(from.pitch);
      const d = add(p, from.middle, -1), right = c * d[1] - s * d[0], ahead = -(c * d[0] + s * d[1]);
      const depth = f * ahead - e * d[2], near = 1 / Math.max(1 + depth / (FAR * view.size), 0.05);
      const k = near * from.scale;
      return { x: width / 2 + from.x + k * right, y: height / 2 + from.y - k * (f * d[2] + e * ahead), depth, k };
    };
    const everything = () => [
      ...shapes.flatMap((shape) => [shape.from, shape.to]),
      ...marks.map((mark) => mark.at).filter((at) => Math.hypot(...add(at, view.middle, -1)) < view.beside),
    ];
    const fit = (from, points = everything(), share = 0.86) => {
      const flat = { ...from, scale: 1, x: 0, y: 0 }, seen = points.map((p) => project(p, flat));
      const [left, right] = [Math.min(...seen.map((p) => p.x)), Math.max(...seen.map((p) => p.x))];
      const [top, bottom] = [Math.min(...seen.map((p) => p.y)), Math.max(...seen.map((p) => p.y))];
      const scale = share * Math.min(width / Math.max(right - left, 0.1), height / Math.max(bottom - top, 0.1));
      return { ...flat, scale, x: -scale * ((left + right - width) / 2), y: -scale * ((top + bottom - height) / 2) };
    };

    // A capsule as seen: two circles and the two lines that touch both.
    const capsule = (a, b, radius) => {
      const r = radius * a.k, q = radius * b.k, apart = Math.hypot(b.x - a.x, b.y - a.y);
      if (apart <= Math.abs(r - q)) {
        const [m, w] = r > q ? [a, r] : [b, q];
        return `M${fixed(m.x - w)} ${fixed(m.y)}a${fixed(w)} ${fixed(w)} 0 1 1 ${fixed(2 * w)} 0a${fixed(w)} ${fixed(w)} 0 1 1 ${fixed(-2 * w)} 0Z`;
      }
      const along = Math.atan2(b.y - a.y, b.x - a.x), half = Math.acos((r - q) / apart);
      const at = (m, w, turn) => `${fixed(m.x + w * Math.cos(along + turn))} ${fixed(m.y + w * Math.sin(along + turn))}`;
      const arc = (w, large) => `A${fixed(w)} ${fixed(w)} 0 ${+large} 1 `;
      return `M${at(a, r, half)}${arc(r, half < Math.PI / 2)}${at(a, r, -half)}L${at(b, q, -half)}${arc(q, half > Math.PI / 2)}${at(b, q, half)}Z`;
    };
    const arrow = (a, b) => {
      const along = Math.atan2(b.y - a.y, b.x - a.x), long = Math.min(7, 0.5 * Math.hypot(b.x - a.x, b.y - a.y));
      const barb = (turn) => `${fixed(b.x - long * Math.cos(along + turn))} ${fixed(b.y - long * Math.sin(along + turn))}`;
      return `M${fixed(a.x)} ${fixed(a.y)}L${fixed(b.x)} ${fixed(b.y)}M${barb(0.45)}L${fixed(b.x)} ${fixed(b.y)}L${barb(-0.45)}`;
    };
    const put = (one, p, dx = 0, dy = 0) => {
      one.setAttribute("x", fixed(p.x + dx));
      one.setAttribute("y", fixed(p.y + dy));
    };
    // Outline of the ellipsoid that holds the true residual with U (k = 2): the ellipse of its projected covariance.
    const ball = (one, tip, cov, by) => {
      const basis = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((e) => {
        const d = project(add(eye.middle, e, 1e-3)), o = project(eye.middle);
        return [(d.x - o.x) / 1e-3, (d.y - o.y) / 1e-3];
      });
      const [xx, xy, xz, yy, yz, zz] = cov, C = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
      const S = (i, j) => basis.reduce((sum, a, k) => sum + basis.reduce((inner, b, l) => inner + a[i] * C[k][l] * b[j], 0), 0);
      const [p, q, r] = [S(0, 0), S(0, 1), S(1, 1)], root = Math.hypot((p - r) / 2, q), size = 2 * by;
      one.setAttribute("rx", fixed(size * Math.sqrt(Math.max((p + r) / 2 + root, 0))));
      one.setAttribute("ry", fixed(size * Math.sqrt(Math.max((p + r) / 2 - root, 0))));
      one.setAttribute("transform", `translate(${fixed(tip.x)} ${fixed(tip.y)}) rotate(${fixed((90 / Math.PI) * Math.atan2(2 * q, p - r))})`);
    };

    let order = "";
    const draw = () => {
      asked = 0;
      const by = { moved: steps(+fields.moved.value), left: steps(+fields.left.value) };
      const others = fields.others.checked || chosen < 0;
      svg.classList.toggle("picked", chosen >= 0);
      for (const shape of shapes) {
        const a = project(shape.from), b = project(shape.to), mine = shape.pose === chosen && chosen >= 0;
        shape.depth = (a.depth + b.depth) / 2;
        shape.one.setAttribute("d", capsule(a, b, shape.radius));
        shape.one.classList.toggle("chosen", mine);
        shape.one.style.display = shape.pose < 0 || mine || others ? "" : "none";
      }
      shapes.sort((a, b) => b.depth - a.depth);
      const now = `${chosen} ${shapes.map((shape) => shape.pose + shape.name).join()}`;
      // What is picked stands before the others, however near they are.
      const mine = shapes.filter((shape) => shape.pose === chosen && chosen >= 0).map((shape) => shape.one);
      if (now !== order) solids.append(...shapes.map((shape) => shape.one), ...mine);
      order = now;
      let named = 0;
      for (const one of arrows) {
        const mine = one.pose === chosen, from = project(one.at), tip = project(add(one.at, one.by, by[one.kind]));
        one.one.style.display = mine || others ? "" : "none";
        one.one.classList.toggle("chosen", mine);
        one.one.setAttribute("d", arrow(from, tip));
        if (!mine || one.kind !== "left") continue;
        put(names[named], from, 6, 14);
        if (balls[named]) ball(balls[named], tip, one.cov, by.left);
        beams[named]?.forEach(([line, at]) => {
          const o = project(at);
          line.setAttribute("d", `M${fixed(o.x)} ${fixed(o.y)}L${fixed(from.x)} ${fixed(from.y)}`);
        });
        named += 1;
      }
      for (const mark of marks) {
        const at = project(mark.at), out = at.k > 4 * eye.scale;
        if (mark.kind === "tracker") mark.one.setAttribute("d", `M${fixed(at.x)} ${fixed(at.y - 8)}l6 12h-12Z`);
        mark.one.setAttribute("cx", fixed(at.x));
        mark.one.setAttribute("cy", fixed(at.y));
        mark.one.style.display = mark.label.style.display = out ? "none" : "";
        put(mark.label, at, 8, 4);
      }
      triad.forEach(({ one, label }, k) => {
        const o = { x: 34, y: height - 34 }, flat = { ...eye, middle: [0, 0, 0], scale: 26, x: 0, y: 0 };
        const tip = project([0, 1, 2].map((axis) => +(axis === k)), flat), dx = tip.x - width / 2, dy = tip.y - height / 2;
        one.setAttribute("d", `M${o.x} ${o.y}l${fixed(dx)} ${fixed(dy)}`);
        put(label, { x: o.x + 1.35 * dx, y: o.y + 1.35 * dy + 4 });
      });
      const last = shapes.find((shape) => shape.pose === chosen && shape.kind === "tool");
      if (chosen >= 0 && last) put(title, project(last.from), 14, -30);
    };
    const soon = () => { asked ||= requestAnimationFrame(draw); };

    const go = (to) => {
      cancelAnimationFrame(moving);
      const from = { ...eye, middle: [...eye.middle] }, began = performance.now();
      const turn = ((to.yaw - from.yaw + 3 * Math.PI) % (2 * Math.PI)) - Math.PI;
      const step = (time) => {
        const t = STILL.matches ? 1 : Math.min((time - began) / 350, 1), s = t * t * (3 - 2 * t);
        const between = (key) => from[key] + s * (to[key] - from[key]);
        eye = {
          yaw: from.yaw + s * turn, pitch: between("pitch"), scale: between("scale"), x: between("x"), y: between("y"),
          middle: from.middle.map((value, k) => value + s * (to.middle[k] - value)),
        };
        draw();
        if (t < 1) moving = requestAnimationFrame(step);
      };
      step(began);
    };
    const whole = (yaw = home.yaw, pitch = home.pitch) => go(fit({ ...home, yaw, pitch }));
    const closer = () => {
      if (chosen < 0) return;
      const mine = shapes.filter((shape) => shape.pose === chosen).flatMap((shape) => [shape.from, shape.to]);
      const sum = mine.reduce((a, b) => add(a, b), [0, 0, 0]);
      go(fit({ ...eye, middle: sum.map((value) => value / mine.length) }, mine, 0.62));
    };
    const turn = (yaw, pitch) => {
      cancelAnimationFrame(moving);
      eye.yaw += yaw;
      eye.pitch = Math.min(Math.max(eye.pitch + pitch, -Math.PI / 2), Math.PI / 2);
      soon();
    };
    const shift = (x, y) => {
      eye.x += x;
      eye.y += y;
      soon();
    };
    const zoom = (factor, x = width / 2, y = height / 2) => {
      cancelAnimationFrame(moving);
      const least = 0.3 * start.scale, most = 60 * start.scale, scale = Math.min(Math.max(eye.scale * factor, least), most);
      const by = scale / eye.scale, px = x - width / 2, py = y - height / 2;
      eye = { ...eye, scale, x: px + by * (eye.x - px), y: py + by * (eye.y - py) };
      soon();
    };
    const pick = (k) => {
      chosen = k;
      fields.pose.value = k < 0 ? "" : String(k);
      says.textContent = k < 0 ? "No pose is picked." : poses[k].says;
      title.textContent = k < 0 ? "" : poses[k].label;
      if (k < 0) title.remove();
      else words.append(title);
      for (const one of [...names.splice(0), ...balls.splice(0), ...beams.splice(0).flatMap((each) => each.map(([line]) => line))]) one?.remove();
      for (const [name, ...at] of k < 0 ? [] : poses[k].points) {
        const told = at.slice(9, 15).every((value) => value !== null);
        names.push(make("text", {}, name));
        balls.push(told ? make("ellipse") : null);
        beams.push((trackers.length === 1 ? trackers : []).map((mark) => [make("path", { class: "sight" }), mark.at]));
        sights.append(...beams.at(-1).map(([line]) => line));
        if (told) vectors.append(balls.at(-1));
        words.append(names.at(-1));
      }
      draw();
    };
    const next = (by) => pick(chosen < 0 ? (by > 0 ? 0 : poses.length - 1) : (chosen + by + poses.length) % poses.length);

    // Mouse and fingers.
    const held = new Map();
    let travelled = 0;
    const spread = () => {
      const [a, b] = [...held.values()];
      return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) };
    };
    const local = (event) => {
      const box = svg.getBoundingClientRect();
      return { x: ((event.clientX - box.x) * width) / box.width, y: ((event.clientY - box.y) * height) / box.height };
    };
    const nearest = (event) => {
      const under = document.elementsFromPoint(event.clientX, event.clientY).find((one) => one.dataset?.pose && solids.contains(one));
      return under ? +under.dataset.pose : -1;
    };
    stage.addEventListener("pointerdown", (event) => {
      if (event.button > 0 && event.pointerType === "mouse") return;
      held.set(event.pointerId, local(event));
      travelled = 0;
      stage.setPointerCapture(event.pointerId);
      stage.classList.add("held");
    });
    stage.addEventListener("pointermove", (event) => {
      const was = held.get(event.pointerId);
      if (!was) return;
      const before = held.size > 1 ? spread() : was, is = local(event);
      held.set(event.pointerId, is);
      travelled += Math.hypot(is.x - was.x, is.y - was.y);
      if (held.size > 1) {
        const after = spread();
        zoom(after.apart / Math.max(before.apart, 1), after.x, after.y);
        shift(after.x - before.x, after.y - before.y);
      } else if (event.shiftKey) shift(is.x - was.x, is.y - was.y);
      else turn(-(is.x - was.x) / 160, (is.y - was.y) / 160);
    });
    const release = (event) => {
      if (!held.delete(event.pointerId)) return;
      stage.classList.remove("held");
      if (event.type !== "pointerup" || travelled > 5) return;
      const k = nearest(event);
      if (k >= 0) pick(k);
    };
    stage.addEventListener("pointerup", release);
    stage.addEventListener("pointercancel", release);
    stage.addEventListener("wheel", (event) => {
      // Who scrolls past must get past: the wheel zooms once the scene is clicked, or with Ctrl as a pinch sends it.
      if (!event.ctrlKey && document.activeElement !== stage) return;
      event.preventDefault();
      const at = local(event);
      zoom(Math.exp(-Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 100) / 400), at.x, at.y);
    }, { passive: false });

    // Keys and buttons.
    const tenth = Math.PI / 18;
    const actions = {
      ArrowLeft: (far) => (far ? shift(40, 0) : turn(tenth, 0)), ArrowRight: (far) => (far ? shift(-40, 0) : turn(-tenth, 0)),
      ArrowUp: (far) => (far ? shift(0, 40) : turn(0, tenth)), ArrowDown: (far) => (far ? shift(0, -40) : turn(0, -tenth)),
      "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8), Home: () => whole(), n: () => next(1), p: () => next(-1),
      Enter: () => closer(), Escape: () => pick(-1),
    };
    stage.addEventListener("keydown", (event) => {
      const act = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
      if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      act(event.shiftKey);
    });
    const buttons = {
      previous: () => next(-1), next: () => next(1), closer, home: () => whole(), above: () => whole(0, Math.PI / 2),
      front: () => whole(0, 0), side: () => whole(-Math.PI / 2, 0), in: () => zoom(1.25), out: () => zoom(0.8),
    };
    tools.addEventListener("click", (event) => buttons[event.target.dataset.do]?.());
    tools.addEventListener("submit", (event) => event.preventDefault());
    tools.addEventListener("input", (event) => {
      if (event.target === fields.pose) return pick(fields.pose.value === "" ? -1 : +fields.pose.value);
      magnification();
      soon();
    });
    const magnification = () => {
      for (const name of ["moved", "left"]) {
        const said = steps(+fields[name].value).toLocaleString("en");
        fields[name].setAttribute("aria-valuetext", `${said} times`);
        fields[name].parentNode.querySelector("output").textContent = `× ${said}`;
      }
    };

    fields.pose.append(...poses.map((pose, k) => new Option(pose.label, k)));
    for (const [k, name] of ["moved", "left"].entries()) {
      fields[name].value = index(numbers.magnify[name]);
      fields[name].parentNode.querySelector(".name").textContent = numbers.names[k];
    }
    magnification();
    const measure = () => {
      const box = stage.getBoundingClientRect();
      width = Math.max(Math.round(box.width), 240);
      height = Math.round(Math.min(Math.max(0.5 * width, 300), 620));
      svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    };
    measure();
    stage.replaceChildren(svg);
    stage.tabIndex = 0;
    stage.setAttribute("role", "application");
    stage.setAttribute("aria-roledescription", "3-D scene");
    stage.setAttribute("aria-label", "The cell in three dimensions: arrow keys turn, plus and minus zoom, N and P pick a pose, Home shows the whole cell");
    tools.hidden = figure.querySelector(".hint").hidden = false;
    const start = fit(home);
    eye = start;
    pick(-1);
    says.textContent = "Pick a pose to see its files, pulls, deflection and residual.";
    new ResizeObserver(() => {
      const was = width;
      measure();
      if (width === was) return;
      eye = fit({ ...home, yaw: eye.yaw, pitch: eye.pitch });
      soon();
    }).observe(stage);
  };
  for (const figure of document.querySelectorAll("figure.scene")) begin(figure);
})();
