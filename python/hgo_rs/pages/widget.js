// The page of a tuning in a cell of a notebook. Each observer.toml that its sliders come to goes to Python.
export default {
  render({ model, el }) {
    const frame = document.createElement("iframe");
    frame.title = "A page to tune in";
    Object.assign(frame.style, { width: "100%", height: "60rem", border: "0" });
    const told = (event) => {
      if (event.source !== frame.contentWindow || !event.data.observer) return;
      model.set("toml", event.data.observer);
      model.save_changes();
    };
    window.addEventListener("message", told);
    frame.srcdoc = model.get("page");
    el.append(frame);
    return () => window.removeEventListener("message", told);
  },
};
