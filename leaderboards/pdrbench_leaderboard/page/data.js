"use strict";
// Numbers that pages fetch when they need them: as scripts, since a page opened from a file may fetch nothing else.
const pdrbench = (() => {
  const root = document.body ? document.body.dataset.root : "";
  const arrived = new Map();
  const waiting = new Map();

  // Called by every file of numbers.
  function receive(key, content) {
    arrived.set(key, content);
  }

  // A promise of the content of `<env>/<what>.js`.
  function fetchData(env, what) {
    const key = `${env}/${what}`;
    if (!waiting.has(key)) {
      waiting.set(
        key,
        new Promise((resolve, reject) => {
          const script = document.createElement("script");
          script.src = root + key.split("/").map(encodeURIComponent).join("/") + ".js";
          script.onload = () => (arrived.has(key) ? resolve(arrived.get(key)) : reject(new Error(`${key}.js is empty`)));
          script.onerror = () => reject(new Error(`${key}.js is not there`));
          document.head.append(script);
        }),
      );
    }
    return waiting.get(key);
  }

  // What the page itself was given.
  function pageFacts() {
    return JSON.parse(document.getElementById("page").textContent);
  }

  return { receive, fetchData, pageFacts };
})();
