// 802.11p stations on one channel in ns-3, driven step by step.  ns3_radio.py compiles it by cppyy.
//
// A caller gives the mean received power of every pair; ns-3 adds Nakagami fading, preamble
// detection, capture, errors by interference, and the contention of the MAC.

#pragma cling optimize(2)

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <unordered_map>
#include <vector>

namespace automcm {

using namespace ns3;

struct Setting
{
    double tx_power_dbm, noise_figure_db, busy_dbm, near_m, far_m, m_near, m_middle, m_far;
    std::uint32_t cw_min, cw_max, aifsn, seed;
    double symbol_us, preamble_us, bits_per_symbol, extra_bits;
    std::string mode;
};

struct Arrived
{
    std::int64_t at_ns, frame;
    std::uint32_t receiver;
};

// How long a station sensed a power above a limit, in bins of 100 ms.
struct Busy
{
    static constexpr std::int64_t BIN_NS = 100'000'000, BINS = 16, COUNTED = 10;

    void Occupy(std::int64_t from, std::int64_t until)
    {
        from = std::max(from, until_ns);
        until_ns = std::max(until, until_ns);
        while (from < until) {
            std::int64_t bin = from / BIN_NS, to = std::min(until, (bin + 1) * BIN_NS);
            if (number[bin % BINS] != bin) {
                number[bin % BINS] = bin;
                busy_ns[bin % BINS] = 0;
            }
            busy_ns[bin % BINS] += to - from;
            from = to;
        }
    }

    double Ratio(std::int64_t now_ns) const
    {
        std::int64_t sum = 0, bin = now_ns / BIN_NS;
        for (std::int64_t i = 0; i < BINS; ++i)
            if (number[i] >= bin - COUNTED && number[i] < bin)
                sum += busy_ns[i];
        return static_cast<double>(sum) / (std::max<std::int64_t>(1, std::min(bin, COUNTED)) * BIN_NS);
    }

    std::int64_t until_ns = 0, number[BINS] = {}, busy_ns[BINS] = {};
};

// The loss of each pair, as the caller sets it, then fading.  It knows the received power, of which
// it keeps the share of busy time.
class PairLoss : public PropagationLossModel
{
  public:
    void Resize(std::uint32_t n)
    {
        loss.assign(static_cast<std::size_t>(n) * n, 1000.0);
        busy.resize(n);
        airtime_ns.resize(n, 0);
        size = n;
    }

    std::vector<double> loss;
    std::vector<std::int64_t> airtime_ns;
    mutable std::vector<Busy> busy;
    std::unordered_map<const MobilityModel*, std::uint32_t> index;
    Ptr<NakagamiPropagationLossModel> fading;
    std::uint32_t size = 0;
    double busy_dbm = -85, faint_dbm = -115;

  private:
    double DoCalcRxPower(double power, Ptr<MobilityModel> a, Ptr<MobilityModel> b) const override
    {
        std::uint32_t from = index.at(PeekPointer(a)), to = index.at(PeekPointer(b));
        power -= loss[static_cast<std::size_t>(from) * size + to];
        if (power < faint_dbm) // fading does not raise it to where anything is sensed
            return power;
        power = fading->CalcRxPower(power, a, b);
        if (power >= busy_dbm) {
            std::int64_t now = Simulator::Now().GetNanoSeconds();
            busy[to].Occupy(now, now + airtime_ns[from]);
        }
        return power;
    }

    std::int64_t DoAssignStreams(std::int64_t stream) override
    {
        return fading->AssignStreams(stream);
    }
};

class Channel80211p
{
  public:
    explicit Channel80211p(const Setting& setting) : s(setting)
    {
        RngSeedManager::SetSeed(s.seed);
        RngSeedManager::SetRun(1);
        channel = CreateObject<YansWifiChannel>();
        Ptr<NakagamiPropagationLossModel> fading = CreateObject<NakagamiPropagationLossModel>();
        fading->SetAttribute("Distance1", DoubleValue(s.near_m));
        fading->SetAttribute("Distance2", DoubleValue(s.far_m));
        fading->SetAttribute("m0", DoubleValue(s.m_near));
        fading->SetAttribute("m1", DoubleValue(s.m_middle));
        fading->SetAttribute("m2", DoubleValue(s.m_far));
        pairs = CreateObject<PairLoss>();
        pairs->busy_dbm = s.busy_dbm;
        pairs->fading = fading;
        pairs->AssignStreams(1);
        channel->SetPropagationLossModel(pairs);
        channel->SetPropagationDelayModel(CreateObject<ConstantSpeedPropagationDelayModel>());
    }

    // Positions in m and losses in dB of all stations; it makes those that are missing.
    void Place(std::uint32_t n, const double* xy, const double* losses)
    {
        if (n > devices.size())
            Grow(n);
        for (std::uint32_t i = 0; i < n; ++i)
            places[i]->SetPosition(Vector(xy[2 * i], xy[2 * i + 1], 1.5));
        std::copy(losses, losses + static_cast<std::size_t>(n) * n, pairs->loss.begin());
    }

    void Send(std::uint32_t station, std::uint32_t bytes, std::int64_t at_ns, std::int64_t frame)
    {
        Time after = NanoSeconds(at_ns) - Simulator::Now();
        Simulator::ScheduleWithContext(
            station, std::max(after, Time(0)), &Channel80211p::Transmit, this, station, bytes, frame);
    }

    void Run(std::int64_t until_ns)
    {
        arrived.clear();
        Simulator::Stop(NanoSeconds(until_ns) - Simulator::Now());
        Simulator::Run();
    }

    std::size_t Arrivals() const { return arrived.size(); }
    // at_ns, frame and receiver of each arrival since the last Run.
    void Copy(std::int64_t* to) const
    {
        for (const Arrived& a : arrived) {
            *to++ = a.at_ns;
            *to++ = a.frame;
            *to++ = a.receiver;
        }
    }

    double BusyRatio(std::uint32_t station) const
    {
        return pairs->busy[station].Ratio(Simulator::Now().GetNanoSeconds());
    }

    static void Destroy() { Simulator::Destroy(); }

  private:
    void Grow(std::uint32_t n)
    {
        WifiHelper wifi;
        wifi.SetStandard(WIFI_STANDARD_80211p);
        wifi.SetRemoteStationManager("ns3::ConstantRateWifiManager",
                                     "DataMode", StringValue(s.mode),
                                     "ControlMode", StringValue(s.mode),
                                     "NonUnicastMode", StringValue(s.mode));
        WifiMacHelper mac;
        mac.SetType("ns3::AdhocWifiMac", "QosSupported", BooleanValue(false));
        YansWifiPhyHelper phy;
        phy.SetErrorRateModel("ns3::NistErrorRateModel");
        phy.SetPreambleDetectionModel("ns3::ThresholdPreambleDetectionModel",
                                      "MinimumRssi", DoubleValue(-101));
        phy.SetFrameCaptureModel("ns3::SimpleFrameCaptureModel");
        phy.SetChannel(channel);
        phy.Set("TxPowerStart", DoubleValue(s.tx_power_dbm));
        phy.Set("TxPowerEnd", DoubleValue(s.tx_power_dbm));
        phy.Set("RxNoiseFigure", DoubleValue(s.noise_figure_db));
        phy.Set("ChannelSettings", StringValue("{0, 10, BAND_5GHZ, 0}"));
        std::uint32_t before = devices.size();
        pairs->Resize(n);
        for (std::uint32_t i = before; i < n; ++i) {
            Ptr<Node> node = CreateObject<Node>();
            Ptr<ConstantPositionMobilityModel> place =
                CreateObject<ConstantPositionMobilityModel>();
            node->AggregateObject(place);
            NetDeviceContainer made = wifi.Install(phy, mac, node);
            wifi.AssignStreams(made, 100 + 100 * static_cast<std::int64_t>(i));
            Ptr<WifiNetDevice> device = DynamicCast<WifiNetDevice>(made.Get(0));
            Ptr<Txop> txop = device->GetMac()->GetTxop();
            txop->SetMinCw(s.cw_min);
            txop->SetMaxCw(s.cw_max);
            txop->SetAifsn(s.aifsn);
            device->SetReceiveCallback(MakeCallback(&Channel80211p::Received, this));
            device->GetPhy()->TraceConnectWithoutContext(
                "PhyTxBegin", MakeBoundCallback(&Channel80211p::Began, this, i));
            ids[PeekPointer(Ptr<NetDevice>(device))] = i;
            pairs->index[PeekPointer(Ptr<MobilityModel>(place))] = i;
            places.push_back(place);
            devices.push_back(device);
        }
    }

    void Transmit(std::uint32_t station, std::uint32_t bytes, std::int64_t frame)
    {
        std::vector<std::uint8_t> data(bytes, 0); // at least 44, for the headers
        std::memcpy(data.data(), &frame, sizeof frame);
        Ptr<Packet> packet = Create<Packet>(data.data(), data.size());
        devices[station]->Send(packet, Mac48Address::GetBroadcast(), 0x8947);
    }

    bool Received(Ptr<NetDevice> device, Ptr<const Packet> packet, std::uint16_t, const Address&)
    {
        std::int64_t frame;
        packet->CopyData(reinterpret_cast<std::uint8_t*>(&frame), sizeof frame);
        arrived.push_back(
            {Simulator::Now().GetNanoSeconds(), frame, ids.at(PeekPointer(device))});
        return true;
    }

    static void Began(Channel80211p* self, std::uint32_t station, Ptr<const Packet> packet, double)
    {
        const Setting& s = self->s;
        double symbols = std::ceil((s.extra_bits + 8.0 * packet->GetSize()) / s.bits_per_symbol);
        std::int64_t ns = std::llround(1000 * (s.preamble_us + s.symbol_us * symbols));
        std::int64_t now = Simulator::Now().GetNanoSeconds();
        self->pairs->airtime_ns[station] = ns;
        self->pairs->busy[station].Occupy(now, now + ns);
    }

    Setting s;
    Ptr<YansWifiChannel> channel;
    Ptr<PairLoss> pairs;
    std::vector<Ptr<WifiNetDevice>> devices;
    std::vector<Ptr<ConstantPositionMobilityModel>> places;
    std::unordered_map<const NetDevice*, std::uint32_t> ids;
    std::vector<Arrived> arrived;
};

} // namespace automcm
