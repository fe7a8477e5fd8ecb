(function () {
  "use strict";
  const one = (selector) => document.querySelector(selector);
  const data = JSON.parse(one("#report-data").textContent);
  const percent = (value) => value === null ? "not known" : Math.round(100 * value) + " %";
  const svg = (name, attributes) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    Object.entries(attributes).forEach(([key, value]) => element.setAttribute(key, value));
    return element;
  };
  const circle = (at, radius) => svg("circle", { cx: data.points[at][0], cy: data.points[at][1], r: radius });

  const drawMap = (state) => {
    const here = one("#here"), before = state.history.filter((entry) => entry.accepted && entry.at >= 0).slice(-40);
    one("#trail").replaceChildren(...before.map((entry) => circle(entry.at, 5)));
    one("#others").replaceChildren(...state.candidates.slice(1).map((found) => circle(found.at, 7)));
    here.classList.toggle("gone", state.at < 0);
    here.classList.toggle("sure", state.accepted);
    if (state.at >= 0) {
      here.setAttribute("cx", data.points[state.at][0]);
      here.setAttribute("cy", data.points[state.at][1]);
    }
    one("#map").setAttribute("aria-label", one("#say").textContent);
  };

  const drawProbability = (state) => {
    const first = data.history - state.history.length;
    one("#probability").replaceChildren(...state.history.map((entry, k) => svg("rect", {
      x: first + k + 0.08, width: 0.84, y: 1 - (entry.probability || 0), height: entry.probability || 0,
      class: entry.accepted ? "r" : "n",
    })));
  };

  const listCandidates = (state) => {
    one("#candidates").replaceChildren(...state.candidates.map((found) => {
      const row = document.createElement("tr");
      [found.place + " · " + found.place_name, found.score.toPrecision(3), percent(found.probability)].forEach((text) => {
        row.appendChild(document.createElement("td")).textContent = text;
      });
      return row;
    }));
  };

  const draw = (state) => {
    ["status", "answered", "recognised", "refused"].forEach((key) => { one("#" + key).textContent = state[key]; });
    if (!state.answered) return;
    const match = state.at < 0 ? "no place" : "place " + state.place + " · " + state.place_name;
    one("#say").textContent = state.at < 0 ? "no match" : (state.accepted ? "" : "perhaps ") + "place " + state.place +
      (state.probability === null ? "" : ", " + percent(state.probability)) + (state.accepted ? "" : ": not accepted");
    one("#query").src = state.query_image;
    one("#match").src = state.match_image;
    one("#query-name").textContent = "image " + state.query + " · " + state.query_name;
    one("#match-name").textContent = match + (state.where ? " · " + state.where : "");
    one("#query").alt = "Query " + state.query_name;
    one("#match").alt = "Reference of " + match;
    one("#raster").src = state.raster;
    listCandidates(state);
    drawMap(state);
    drawProbability(state);
    document.documentElement.dataset.ready = "yes";
  };

  let seen = -1;
  const ask = () => fetch("state?seen=" + seen, { cache: "no-store" }).then((answer) => answer.json()).then((state) => {
    if (state.version !== seen) draw(state);
    seen = state.version;
    setTimeout(ask, 250);
  }).catch(() => {
    seen = -1;
    one("#status").textContent = "ended: lava-vpr does not answer";
    setTimeout(ask, 2000);
  });
  ask();
})();
