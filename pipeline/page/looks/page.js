"use strict";
// Forms and fields: what is typed goes to the server, which answers with a sentence or a place to go.

const problem = document.getElementById("problem");

function complain(words) {
  problem.textContent = words;
  problem.hidden = !words;
  if (words) problem.scrollIntoView({ block: "nearest" });
}

function again(field) {  // whoever types goes on behind the field they were in
  sessionStorage.setItem("at", field.id);
  location.reload();
}

document.getElementById(sessionStorage.getItem("at") || "-")?.focus();
sessionStorage.removeItem("at");

async function ask(method, url, body) {
  let answer, said;
  try {
    answer = await fetch(url, { method, body, redirect: "error" });
    said = await answer.json();
  } catch {
    said = { problem: "The program behind this page does not answer: is it still running in its terminal?" };
  }
  complain(said.problem || "");
  return said;
}

function posts(form) {
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const button = form.querySelector("button");
    button.disabled = true;
    form.setAttribute("aria-busy", "true");
    const status = form.querySelector("[data-busy]"), before = status?.textContent;
    if (status) status.textContent = status.dataset.busy;
    const said = await ask("POST", form.dataset.post, JSON.stringify(Object.fromEntries(new FormData(form))));
    button.disabled = false;
    form.removeAttribute("aria-busy");
    if (status) status.textContent = before;
    if (said.go) location.href = said.go;
    else if (said.problem) return;
    else if (form.dataset.then === "progress") location.reload();  // the stages above show it, too
    else if (form.dataset.then === "live") follow();
    else if ("reload" in form.dataset) location.reload();
  });
}

document.querySelectorAll("form[data-post]").forEach(posts);

// --- files

async function take(files) {
  const taking = document.getElementById("taking"), base = `/c/${document.body.dataset.campaign}/file/`;
  let wrong = "";
  for (const file of files) {
    taking.textContent = `taking ${file.name}`;
    const where = base + encodeURIComponent(file.name);
    let said = await ask("PUT", where, file);
    if (said.problem && said.problem.includes("replace it") && confirm(`${said.problem}.\nReplace it?`))
      said = await ask("PUT", `${where}?instead=1`, file);
    if (said.problem) wrong += `${file.name}: ${said.problem}\n`;
  }
  taking.textContent = "";
  if (wrong) complain(wrong);
  else location.reload();
}

async function within(entry) {
  if (entry.isFile) return [await new Promise((done, failed) => entry.file(done, failed))];
  const reader = entry.createReader(), found = [];
  for (;;) {
    const some = await new Promise((done, failed) => reader.readEntries(done, failed));
    if (!some.length) break;
    for (const one of some) if (!one.name.startsWith(".")) found.push(...await within(one));
  }
  return found;
}

const drop = document.getElementById("drop");
if (drop) {
  const pick = document.getElementById("pick");
  pick.addEventListener("change", () => take(pick.files));
  pick.addEventListener("keydown", (event) => { if (event.key === "Enter") pick.click(); });  // as Space does
  for (const name of ["dragover", "dragleave", "drop"])
    document.addEventListener(name, (event) => {
      event.preventDefault();
      drop.classList.toggle("over", name === "dragover");
    });
  document.addEventListener("drop", async (event) => {
    const dropped = [...event.dataTransfer.items].map((one) => one.webkitGetAsEntry()).filter(Boolean);
    const files = [];
    for (const one of dropped) files.push(...await within(one));
    take(files);
  });
}

function look(section) {
  fetch(section.dataset.look).then(async (answer) => {
    if (!answer.ok) throw new Error((await answer.json()).problem);
    section.innerHTML = await answer.text();  // of our templates: all that a file says is escaped
    section.querySelectorAll("form[data-post]").forEach(posts);
    section.querySelector("[data-delete]")?.addEventListener("click", async (event) => {
      const said = await ask("DELETE", event.target.dataset.delete);
      if (!said.problem) location.reload();
    });
  }).catch((problem) => { section.querySelector("p").textContent = problem.message; });
}

const seen = new IntersectionObserver((found) => {  // of a hundred files those that are looked at
  for (const one of found) if (one.isIntersecting) { seen.unobserve(one.target); look(one.target); }
}, { rootMargin: "50%" });
document.querySelectorAll("[data-look]").forEach((section) => seen.observe(section));

// --- setup

const fields = document.getElementById("fields");
let waiting = Promise.resolve(), pending = 0;

function inTurn(work) {  // answers are written one after the other; links wait for the last one
  pending += 1;
  fields.setAttribute("aria-busy", "true");
  waiting = waiting.then(work).finally(() => {
    pending -= 1;
    if (!pending) fields.removeAttribute("aria-busy");
  });
}

document.addEventListener("click", (event) => {
  const link = event.target.closest("a[href]");
  if (!pending || !link) return;
  event.preventDefault();
  waiting.finally(() => { location.href = link.href; });
});

async function fill(line, said, unit, inputs) {
  const all = fields.querySelectorAll("input, select, button"), whole = "decides" in inputs[0].dataset;
  if (whole) for (const one of all) one.disabled = true;  // other entries may follow from it
  const answer = await ask("POST", fields.dataset.fill, JSON.stringify({ line, said, unit, seen: fields.dataset.seen }));
  if (answer.reload) return again(inputs[0]);
  if (whole) for (const one of all) one.disabled = false;
  if (answer.seen) {
    fields.dataset.seen = answer.seen;
    for (const one of document.querySelectorAll("input[name=seen]")) one.value = answer.seen;
  }
  for (const one of inputs) {
    one.classList.toggle("bad", !answer.seen);
    one.classList.toggle("kept", !!answer.seen);
  }
}

if (fields) {
  fields.addEventListener("submit", (event) => event.preventDefault());
  // by the arrow keys a closed list changes with every step: it is written when it is left
  let keys = false;
  fields.addEventListener("keydown", () => { keys = true; });
  fields.addEventListener("pointerdown", () => { keys = false; });
  fields.addEventListener("change", (event) => {
    const input = event.target;
    if (!keys || input.tagName !== "SELECT" || document.activeElement !== input) return write(input);
    input.onblur = () => { input.onblur = null; write(input); };
  });

  function write(input) {
    const line = Number(input.dataset.line);
    if (!line) return;
    const all = [...fields.querySelectorAll(`[data-line="${line}"]`)];
    const unit = input.closest("section").querySelector("[data-unit]")?.value || "m";
    const place = input.classList.contains("place");
    if (place && all.some((one) => !one.value.trim()) && all.some((one) => one.value.trim())) return;
    const said = place ? all.map((one) => one.value) : input.value;
    inTurn(() => fill(line, said, unit, all));
  }

  for (const button of fields.querySelectorAll("[data-confirm]"))
    button.addEventListener("click", () => {
      button.disabled = true;
      inTurn(async () => {
        const said = await ask("POST", fields.dataset.fill, JSON.stringify({ line: Number(button.dataset.confirm), confirm: true, seen: fields.dataset.seen }));
        button.disabled = false;
        if (!said.problem) again(button);
      });
    });
  // rows of a spreadsheet: cells of the first row from the one pasted into, further rows below it
  fields.addEventListener("paste", (event) => {
    const input = event.target, text = event.clipboardData.getData("text");
    if (!input.classList?.contains("place") || !/[\t\n]/.test(text.trim())) return;
    event.preventDefault();
    const rows = [...input.closest("table").rows].filter((row) => row.querySelector(".place"));
    const names = rows.map((row) => row.querySelector("th").textContent.trim());
    text.trim().split(/\r?\n/).forEach((line, k) => {
      const cells = line.split("\t").map((one) => one.trim());
      const named = names.indexOf(cells[0]);
      const row = named >= 0 ? rows[named] : rows[rows.indexOf(input.closest("tr")) + k];
      const values = named >= 0 || cells.length > 3 ? cells.slice(-3) : cells;
      const inputs = row ? [...row.querySelectorAll(".place")] : [];
      inputs.forEach((one, axis) => { if (values[axis] !== undefined) one.value = values[axis]; });
      inputs.at(-1)?.dispatchEvent(new Event("change", { bubbles: true }));
    });
  });
  for (const unit of fields.querySelectorAll("[data-unit]"))
    unit.addEventListener("change", () => {
      const size = { m: 1, mm: 1e-3, in: 0.0254 }, was = unit.dataset.was || "m";
      for (const one of unit.closest("section").querySelectorAll(".place"))
        if (one.value) one.value = String(Number((Number(one.value.replace(",", ".")) * size[was] / size[unit.value]).toPrecision(10)));
      unit.dataset.was = unit.value;
    });
}

// --- run

const watched = document.getElementById("progress");

async function watch() {
  const [begin, stop] = watched.querySelectorAll("form");
  const [status, words, after] = [watched.querySelector("[role=status]"), watched.querySelector(".words"), watched.querySelector(".after")];
  for (let began = false; ;) {
    let now;
    try { now = await (await fetch(watched.dataset.progress)).json(); } catch { now = { state: "lost" }; }
    if (!now.state) { await new Promise((done) => setTimeout(done, 500)); continue; }
    const running = now.state === "running";
    if (began && !running && now.state !== "lost") return location.reload();  // as above
    began = running;
    begin.hidden = running;
    stop.hidden = !running;
    const time = now.seconds === undefined ? "" : ` ${now.seconds.toFixed(0)} s`;
    status.textContent = { none: "", running: `computing,${time}${now.at ? `: ${now.at}` : ""}`, done: `done in${time}`, failed: `failed after${time}`, cancelled: `cancelled after${time}; nothing was changed`, lost: "the program behind this page does not answer" }[now.state];
    words.textContent = (now.words || []).join("\n");
    after.hidden = now.state !== "done";
    if (!running) break;
    await new Promise((done) => setTimeout(done, 500));
  }
}

if (watched) watch();

// --- while it is measured

const live = document.getElementById("live");
let following = false;

function beep() {
  const sound = new AudioContext(), tone = sound.createOscillator();
  tone.frequency.value = 660;
  tone.connect(sound.destination);
  tone.start();
  tone.stop(sound.currentTime + 0.4);
}

async function follow() {
  if (following) return;
  following = true;
  const [begin, stop] = live.querySelectorAll("form"), shown = live.querySelector("section");
  for (let told = 0, suspects = 0; ;) {
    let now;
    try { now = await (await fetch(live.dataset.now)).json(); } catch { break; }
    begin.hidden = now.running;
    stop.hidden = !now.running;
    if (now.told !== told || !now.running) shown.innerHTML = now.html;
    if (now.suspects > suspects && document.getElementById("sound").checked) beep();
    ({ told, suspects } = now);
    if (!now.running) break;
    await new Promise((done) => setTimeout(done, 1000));
  }
  following = false;
}

if (live && live.dataset.running === "yes") follow();

// --- answer

const correct = document.getElementById("correct");
if (correct) correct.addEventListener("submit", async (event) => {
  event.preventDefault();
  const files = [...document.getElementById("program").files];
  const done = correct.querySelector("#done");
  done.replaceChildren();
  for (const file of files) {
    const stem = (one) => one.name.replace(/\.[^.]*$/, "").toLowerCase();
    const other = files.find((one) => one !== file && stem(one) === stem(file));  // the .dat of a .src
    const options = new URLSearchParams([...new FormData(correct)].filter(([, value]) => typeof value === "string" && value));
    if (other) { options.set("first", file.size); options.set("beside", other.name); }
    const said = await ask("POST", `${correct.dataset.correct}${encodeURIComponent(file.name)}?${options}`, other ? new Blob([file, other]) : file);
    const part = document.getElementById("part").content.cloneNode(true);
    part.querySelector("h3").textContent = file.name;
    part.querySelector(".words").textContent = (said.words || [said.problem]).join("\n");
    const table = part.querySelector(".diff"), save = part.querySelector("a");
    table.hidden = save.hidden = !said.rows;
    table.tBodies[0].replaceChildren(...(said.rows || []).map((one) => {
      const row = document.createElement("tr");
      for (const cell of [one.line, one.old, one.new]) row.insertCell().textContent = cell;
      return row;
    }));
    if (said.rows) {
      const bytes = Uint8Array.from(said.corrected, (letter) => letter.charCodeAt(0));
      save.href = URL.createObjectURL(new Blob([bytes]));
      save.download = file.name.replace(/(\.[^.]*)?$/, "-corrected$1");
    }
    done.append(part);
  }
});
