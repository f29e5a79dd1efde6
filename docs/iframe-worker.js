// Pages opened from a folder may start no worker: the search's script runs in a hidden frame there.
if (location.protocol === "file:") window.Worker = class extends EventTarget {
  constructor(url) {
    super();
    const frame = document.body.appendChild(document.createElement("iframe"));
    frame.hidden = true;
    const inside = frame.contentWindow;
    inside.document.open();  // before anything is set: it begins a new page
    inside.postMessage = (data) => {
      const message = new MessageEvent("message", { data });
      this.dispatchEvent(message);
      this.onmessage?.(message);
    };
    inside.importScripts = (...urls) => urls.reduce((before, src) => before.then(() =>
      new Promise((onload, onerror) => inside.document.body.append(
        Object.assign(inside.document.createElement("script"), { src, onload, onerror })))), Promise.resolve());
    inside.document.write(`<body><script src="${url}"></script></body>`);
    inside.document.close();
    this.ready = new Promise((loaded) => inside.addEventListener("load", () => loaded(inside)));
  }
  postMessage(data) {
    this.ready.then((inside) => inside.dispatchEvent(new MessageEvent("message", { data })));
  }
};
